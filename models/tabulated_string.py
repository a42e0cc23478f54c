"""A drill string from its tables: sections, survey, mud, top drive and bit, lumped into a chain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np

from models.drag_effects import TorqueDragEffects, torque_drag_effects
from models.drill_string import TorsionalChain
from models.friction_calibration import FrictionCalibration, calibrate_friction
from models.friction_factors import FrictionFactors
from models.lumping import MOST, Lumping
from models.sections import Section, sections_of
from models.soft_string import side_force
from models.survey import Survey, hole_of
from models.torque_and_drag import TorqueDragOperations, torque_drag_operations
from toolbox import FrictionLaw, SceneError, quantity
from toolbox.authoring import NumberOrText, entries, number, whole
from toolbox.modelling import OptionalQuantities


@dataclass(frozen=True)
class DrillString(TorsionalChain):
    """Torsional chain of a drill string from tables of its sections and its survey.

    The method `DrillString.from_tables` makes such a chain, and then the field `depth` contains the measured depths of
    its inertias [m]. Without tables, as in the example, it is a `TorsionalChain` with default values.

    Examples
    --------
    >>> from models import DrillString
    >>> from toolbox import compose
    >>> print(compose(DrillString()))
    HybridSystem(DrillString): 3 states (chain.twist, chain.speed); contacts: none; inputs: top.torque [N m], bit.torque [N m]
    """

    depth: OptionalQuantities = quantity(None, "m", "measured depth of every inertia, for profiles", at_least=0)

    def check(self):
        super().check()
        entries("chain.depth", self.depth, len(self.inertia), ", one for each inertia")

    @classmethod
    def from_tables(
        cls,
        sections: Path | str | Sequence[Section],
        survey: Path | str | Survey | None = None,
        *,
        top_inertia: Annotated[NumberOrText, "kg m2"],
        bit_inertia: Annotated[NumberOrText, "kg m2"] = 0.0,
        band: Annotated[NumberOrText, "Hz"] = 2.0,
        elements: int | None = None,
        friction: FrictionLaw | None = None,
        on_bottom: bool = False,
        mud_density: Annotated[NumberOrText, "kg/m3"] = 0.0,
        doglegs: bool = False,
        weight_on_bit: Annotated[NumberOrText, "N"] = 0.0,
        drag_rate: Annotated[NumberOrText, "1/s"] = 0.0,
        internal_damping: Annotated[NumberOrText, "s"] = 0.0,
        top_drag: Annotated[NumberOrText, "N m s/rad"] = 0.0,
        bit_drag: Annotated[NumberOrText, "N m s/rad"] = 0.0,
        end_depth: Annotated[NumberOrText | None, "m"] = None,
        friction_factors: Sequence[Sequence[NumberOrText]] | None = None,
        name: str | None = None,
    ) -> DrillString:
        """Make the chain of a drill string from its sections (top first) and, for friction along the string, its survey.

            J rho w_t + tau_x = -drag_rate rho J w - F,   |F| <= mu n r_o

        w is the speed of rotation, tau the torque, rho J the inertia per length, F the friction torque per length, mu
        the coefficient of friction, n the side force per length, and r_o the outer radius of the tool joints, or of a
        pipe without tool joints.

        Parameters
        ----------
        sections, survey
            Sections of the string and survey of its borehole: paths of tables (CSV or TOML), or a sequence of `Section`
            and a `Survey`. By default no survey: a string without friction along it. `read_sections` and `read_survey`
            describe the columns of the tables.
        top_inertia
            Inertia of the rigid rotating parts at the top, seen from the string: motor and gears [kg m2].
        bit_inertia
            Rigid inertia at the bit [kg m2], by default 0.
        band
            Frequency [Hz] up to which natural frequencies are accurate to 1 %, by default 2. The number of elements
            follows from this frequency. Friction along the string may need more elements than the vibration of the
            whole string: `python -m studies detail` prints the influence and the cost of more elements.
        elements
            Number of elements. By default None: the number follows from the band. The number of inertias is larger by
            one.
        friction
            Friction law between string and borehole, such as `Coulomb(static=0.35, kinetic=0.25)`. By default None: no
            friction. Only inertias with a side force get a contact.
        on_bottom
            Whether the bit is on bottom, so that rock acts on the last inertia and friction along the string does not,
            by default False. The inertia above the last one then gets its share of the friction.
        mud_density
            Density of the mud for buoyancy [kg/m3], by default 0 (no mud).
        doglegs
            Whether the side force n includes the effect of the tension in curved parts of the borehole (Johancsik), by
            default False. Otherwise n = w sin(inc), with the weight per length w.
        weight_on_bit
            Weight on bit [N], which reduces the tension that `doglegs` uses, by default 0.
        drag_rate
            Viscous drag per inertia of the string [1/s], by default 0.
        internal_damping
            Damping of the springs per stiffness [s], by default 0.
        top_drag, bit_drag
            Drag at the ends [N m s/rad], by default 0.
        end_depth
            Measured depth at which the string ends [m]. The length of the first section, the drill pipe, is changed to
            fit, and the sections below it keep their length. By default None: all sections keep their length.
        friction_factors
            Kinetic coefficients of friction over depth, in place of the coefficient of `friction`: pairs (depth,
            coefficient) from the top. By default None: the same coefficient at every depth. Each coefficient holds down
            to its measured depth [m], the last one to the end of the string. For a casing above an open hole: `[["2200
            m", 0.2], ["3800 m", 0.3]]`. The static coefficient keeps its ratio to the kinetic coefficient.
        name
            Name of the part, needed if a plant has two chains. By default None: the name "chain".

        Returns
        -------
        DrillString
            The chain.

        Raises
        ------
        SceneError
            If one of these is true.

            - A table is bad (the message names file, row and column), or an argument is out of range.
            - Friction is given without a survey.
            - The survey ends above the bit.
            - The sections below the first one are longer than the depth.
        """
        top_inertia, bit_inertia = (
            number(word, value, "kg m2", at_least=0) for word, value in (("top_inertia", top_inertia), ("bit_inertia", bit_inertia))
        )
        mud_density = number("mud_density", mud_density, "kg/m3", at_least=0)
        weight_on_bit = number("weight_on_bit", weight_on_bit, "N", at_least=0)
        drag_rate, internal_damping = (
            number("drag_rate", drag_rate, "1/s", at_least=0),
            number("internal_damping", internal_damping, "s", at_least=0),
        )
        top_drag, bit_drag = (
            number(word, value, "N m s/rad", at_least=0) for word, value in (("top_drag", top_drag), ("bit_drag", bit_drag))
        )
        band = number("band", band, "Hz", above=0)
        if elements is not None:
            whole("elements", elements, 1, MOST)
        if weight_on_bit and not doglegs:
            raise SceneError("Argument `weight_on_bit` must come with `doglegs`, because without them no tension enters.")
        pipes = sections_of(sections) if end_depth is None else _ending_at(sections_of(sections), end_depth)
        if mud_density >= min(section.density for section in pipes):
            raise SceneError(f"Argument `mud_density` must be smaller than the density of every section, but it is {mud_density:g} kg/m3.")
        hole = hole_of(survey, sum(section.length for section in pipes)) if survey is not None else None
        lumping = Lumping.of_band(pipes, band) if elements is None else Lumping.of_count(pipes, int(elements))
        inertia = lumping.shared(lambda s: lumping.along([section.inertia_per_length for section in pipes], s))
        fields: dict[str, Any] = {"drag": tuple((drag_rate * inertia).tolist())} if drag_rate else {}
        inertia[0] += top_inertia
        inertia[-1] += bit_inertia
        if friction_factors is not None and not getattr(friction, "kinetic", 0.0):
            raise SceneError(
                f"Argument `friction_factors` must come with a `friction` that has a kinetic coefficient, but that is {friction!r}."
            )
        if friction is not None:
            if hole is None:
                raise SceneError("Argument `survey` must be given with `friction`, because the side force follows from it.")

            end = sum(section.length for section in pipes)
            factors = None if friction_factors is None else FrictionFactors.of("friction_factors", friction_factors, end)

            def torque(s: np.ndarray) -> np.ndarray:
                part = 1.0 if factors is None else factors.at(s) / float(friction.kinetic)  # type: ignore[attr-defined]
                force = part * side_force(pipes, hole, s, mud_density=mud_density, weight_on_bit=weight_on_bit, doglegs=doglegs)
                return force * lumping.along([section.contact_radius for section in pipes], s)

            load = lumping.shared(torque, hole.depth if factors is None else (*hole.depth, *factors.depths))
            if on_bottom:
                load[-2] += load[-1]
                load[-1] = 0.0
            rubbing = np.flatnonzero(load > 1e-6 * load.sum())
            if not rubbing.size:
                raise SceneError(
                    "Argument `friction` must come with a hole that bears the string somewhere, but no side force acts anywhere."
                )
            fields |= {"friction": friction, "friction_load": tuple(load[rubbing].tolist()), "friction_at": tuple(rubbing.tolist())}
        return cls(
            inertia=tuple(inertia.tolist()),
            stiffness=tuple(lumping.stiffness.tolist()),
            damping=tuple((internal_damping * lumping.stiffness).tolist()),
            top_drag=float(top_drag),
            bit_drag=float(bit_drag),
            depth=tuple(lumping.nodes.tolist()),
            name=name,
            **fields,
        )

    torque_drag_results: ClassVar[Mapping[str, type]] = {
        "friction_factors": FrictionCalibration,
        "torquedrag": TorqueDragOperations,
        "effects": TorqueDragEffects,
    }
    """{name of a result of `stickslip torquedrag`: its class}."""

    @staticmethod
    def torque_and_drag(tables: Mapping[str, Any], **changes: Any) -> TorqueDragOperations:
        """Compute torque and drag of a string from tables, for the usual operations of a rig.

        Parameters
        ----------
        tables
            {argument of `from_tables`: value}. These are used: sections, survey, friction, friction_factors,
            mud_density, weight_on_bit and end_depth.
        changes
            Arguments of `torque_drag_operations` that replace the values of the tables.

        Returns
        -------
        TorqueDragOperations
            Hook load, drag and torque of every operation.

        Raises
        ------
        SceneError
            If there is no survey, no friction, or an argument is out of range.
        """
        pipes, hole, known = _in_hole(tables, "friction" in changes)
        return torque_drag_operations(pipes, hole, **{**known, **changes})

    @staticmethod
    def torque_and_drag_effects(tables: Mapping[str, Any], **changes: Any) -> TorqueDragEffects:
        """Compute how much each number of a string from tables influences hook load and torque.

        The numbers are: the friction factor of each part of the borehole, mud density, weight on bit, torque on bit, and
        the weight of the string in air. Each number is changed by itself, to 10 % below and 10 % above its value. Numbers
        that are 0 are left out.

        Parameters
        ----------
        tables
            {argument of `from_tables`: value}. These are used: sections, survey, friction, friction_factors,
            mud_density, weight_on_bit and end_depth.
        changes
            Arguments of `torque_drag_effects` that replace or complete the values of the tables, such as
            `bit_torque="8 kN m"`, or `change=0.2` for 20 % in place of 10 %.

        Returns
        -------
        TorqueDragEffects
            For each number, the changes of the hook load while picking up and while slacking off [N], and of the torque
            at the top while rotating [N m]. `low` contains the changes for the lower value and `high` for the higher
            value, both of shape (numbers, 3).

        Raises
        ------
        SceneError
            If there is no survey, no friction, or an argument is out of range.
        """
        pipes, hole, known = _in_hole(tables, "friction" in changes)
        return torque_drag_effects(pipes, hole, **{**known, **changes})

    @staticmethod
    def calibrated_friction(
        tables: Mapping[str, Any], measurements: Any, depths: Sequence[Any] | None = None, **changes: Any
    ) -> FrictionCalibration:
        """Find the friction factors of a borehole from measured hook loads and torques of a string from tables.

        Parameters
        ----------
        tables
            {argument of `from_tables`: value}. These are used: sections, survey, friction_factors, mud_density and
            end_depth.
        measurements
            Measurements, as for `calibrate_friction`.
        depths
            Measured depths at which the friction factors end [m]. By default those of `friction_factors`, and without
            these one factor for the whole borehole.
        changes
            Other arguments of `calibrate_friction`.

        Returns
        -------
        FrictionCalibration
            The friction factors with 95 % intervals.

        Raises
        ------
        SceneError
            If there is no survey, or an argument is out of range.
        """
        pipes, hole, known = _in_hole(tables, True)
        factors = tables.get("friction_factors")
        ends = depths or ([depth for depth, _ in factors] if factors else None)
        mud = {name: known[name] for name in ("mud_density",) if name in known}
        return calibrate_friction(pipes, hole, measurements, ends, **{**mud, **changes})


def _in_hole(tables: Mapping[str, Any], other_friction: bool) -> tuple[Sequence[Section], Survey, dict[str, Any]]:
    """(sections, survey, known arguments of torque and drag) of the tables of a string. Raises SceneError without a survey, or without any friction."""
    if tables.get("survey") is None:
        raise SceneError("Argument `survey` must be given with `sections`, because side forces follow from the path of the hole.")
    pipes = sections_of(tables["sections"])
    if tables.get("end_depth") is not None:
        pipes = _ending_at(pipes, tables["end_depth"])
    friction = tables.get("friction_factors") or getattr(tables.get("friction"), "kinetic", None)
    if not other_friction and friction is None:
        raise SceneError("Argument `friction` must be given: a law with a kinetic coefficient, or friction factors.")
    known = {name: tables[name] for name in ("mud_density", "weight_on_bit") if name in tables}
    return pipes, hole_of(tables["survey"], sum(each.length for each in pipes)), {"friction": friction, **known}


def _ending_at(pipes: Sequence[Section], depth: NumberOrText) -> tuple[Section, ...]:
    """Sections of which the first is so long that the last ends at a depth [m]."""
    below = sum(section.length for section in pipes[1:])
    return (replace(pipes[0], length=number("end_depth", depth, "m", above=below) - below), *pipes[1:])
