"""Scenes: a plant, the controllers to be compared on it, what happens and what to look at. `scene_file` and `saving` have their TOML form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from toolbox.arguments import number
from toolbox.errors import SceneError, suggest
from toolbox.files.unit_systems import asked_units
from toolbox.messages import LOG
from toolbox.modelling.closed_loop import ClosedLoop, why_without_effect
from toolbox.modelling.closing import laws_of
from toolbox.modelling.components import Component
from toolbox.modelling.composition import compose
from toolbox.modelling.hybrid_system import HybridSystem, checked_plant
from toolbox.modelling.laws import Controller, Sampled
from toolbox.modelling.start import place_start
from toolbox.scenes import keys, saving, scene_file
from toolbox.scenes.cases import Case, Labelled, Measured, Number, Waveform, _reference
from toolbox.scenes.judged import judged_effort, judged_element, judged_speed, set_point
from toolbox.simulation.request import Request
from toolbox.simulation.simulate import simulate
from toolbox.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from toolbox.modelling.dependencies import Dependencies


@dataclass(frozen=True)
class Scene(Labelled):
    """Plant, controllers to compare on it, length of the runs, and the signals that are evaluated. All numbers are in
    SI.

    Attributes
    ----------
    title
        Title of the scene.
    parts
        Parts of the plant.
    cases
        One `Case` per controller, with different labels.
    duration
        Length of the runs [s].
    element
        Name of the contact whose stick phases are counted. None if the plant has no contact that can stick.
    signal
        Name of the signal, usually a speed, whose severity, settling and overshoot are computed.
    effort
        Name of the input whose peak is reported.
    after
        Time from which on a run is evaluated [s].
    reference
        Set-point of `signal`. None for no set-point.
    accuracy
        Target for the global error of the runs, by default 1e-6.
    start, inputs, parameters
        Start values, inputs and parameters for all cases, as in `simulate`. If a case has an input of the same name,
        the value of the case is used.
    standstill_speed
        For a stop, the value of `signal` at which the machine counts as standing. The evaluation then ends at the
        standstill, and the stick phase in which the machine stands does not count.
    measured
        Measured results of the machine, which a study shows beside the simulated ones. None for no measurement.
    units
        {SI unit: unit for display}. By default the units that were typed, see `display_units`.

    Examples
    --------
    >>> from controllers import SoftTorque, StiffPI
    >>> from models import BitRock, wells
    >>> from toolbox import Scene, compose
    >>> drives = {"stiff": StiffPI(reference="120 rpm"), "soft": SoftTorque(reference="120 rpm")}
    >>> scene = Scene.of(compose(wells.JANSEN_2, BitRock(weight="60 kN")), "60 s", drives)
    >>> print(f"{scene.run('soft')['bit.speed'][-1]:.1f} rad/s")
    12.6 rad/s
    """

    title: str
    parts: tuple[Component, ...]
    cases: tuple[Case, ...]
    duration: float
    element: str | None
    signal: str
    effort: str
    after: float
    accuracy: float = 1e-6
    reference: float | None = None
    standstill_speed: float | None = None
    start: Mapping[str, Number] = field(default_factory=dict)
    inputs: Mapping[str, float | Waveform] = field(default_factory=dict)
    parameters: Mapping[str, Number] = field(default_factory=dict)
    measured: Measured | None = None
    units: Mapping[str, str] = field(default_factory=dict, compare=False)

    @staticmethod
    def of(
        plant: HybridSystem,
        duration: float,
        controllers: Mapping[str, Controller | Sampled | None] | None = None,
        *,
        title: str = "",
        element: str | None = None,
        signal: str | None = None,
        effort: str | None = None,
        after: float | None = None,
        reference: float | None = None,
        **others: Any,
    ) -> Scene:
        """Make and check a scene that compares several controllers on one plant.

        Arguments that are left out have the same defaults as in a scene file.

        Parameters
        ----------
        plant
            The plant.
        duration
            Length of the runs [s].
        controllers
            {label: controller}. A value None is a case without a controller. By default (None) the scene has one case,
            without a controller.
        element
            Name of the contact whose stick phases are counted. By default the only contact, if there is one.
        signal
            Name of the speed that is evaluated. By default `<element>.speed` if the plant has it, else the slip of the contact. It
            must be given if there is no contact.
        effort
            Name of the input whose peak is reported. By default the first force or torque, else the first input.
        after
            Time from which on the run is evaluated [s]. By default half of the duration.
        reference
            Set-point of the signal. By default the set-point of the controllers, if all have the same.
        title
            Title of the scene. By default the classes of its parts.
        others
            Further fields of `Scene` as keyword arguments: `accuracy`, `standstill_speed`, `start`, `inputs`,
            `parameters` and `measured`. Example: `inputs={"bit.weight": 80e3}`.

        Returns
        -------
        Scene
            The scene.

        Raises
        ------
        SceneError
            If an argument is wrong or does not fit the plant.
        """
        checked_plant(plant)
        duration = number("duration", duration, "s", above=0)
        contacts = [each.name for each in plant.elements if element not in plant.modeless] or [*plant.modeless]
        if not contacts and signal is None:
            raise SceneError(
                "Argument `plant` must have a contact that can stick, or come with the `signal` to be judged, but it has none."
            )
        element = judged_element(contacts, element)
        cases = tuple(Case.of(label, law) for label, law in (controllers or {"no controller": None}).items())
        signal = signal or judged_speed(plant, element or "")
        element = None if element in plant.modeless else element
        wished = {_reference(case.law, plant.signal_unit(signal)) for case in cases}
        reference = wished.pop() if reference is None and len(wished) == 1 else reference
        scene = Scene(
            title or ", ".join(type(part).__name__ for part in plant.parts), plant.parts, cases, float(duration), element, signal,
            effort or judged_effort(plant, signal), duration / 2 if after is None else after, reference=reference, **others,
        )  # fmt: skip
        scene.check()
        return scene

    @staticmethod
    def load(path: str | Path, *, depth: float | str | None = None, refined: bool = False) -> Scene:
        """Read and check the scene in a TOML file.

        Parameters
        ----------
        path
            Path of the file.
        depth
            Measured depth [m], or text with a unit, at which a drill string from tables ends. It replaces the depth in
            the file. By default None: the depth in the file.
        refined
            Whether drill strings from tables get twice as many elements, to check that the number of elements is large
            enough. By default False.

        Returns
        -------
        Scene
            The scene.

        Raises
        ------
        SceneError
            If the file cannot be read or the scene is wrong. The message names the file and the fault.
        """
        path = Path(path)
        try:
            scene = Scene(**scene_file.read(path, depth, refined))
            scene.check()
        except SceneError as error:
            raise SceneError(f"Scene `{path}`: {error}") from None
        return scene

    def save(self, path: str | Path) -> Path:
        """Write the scene to a TOML file, with parameters in SI and the units for display, and return the path of the file.

        `Scene.load` of the file gives an equal scene. If writing fails, an older file stays unchanged.

        Parameters
        ----------
        path
            Path of the file.

        Raises
        ------
        SceneError
            If the file cannot be written, or if the class of a part is not in the catalogue of parts that scene files can
            name.
        """
        saving.write(
            {each.name: getattr(self, each.name) for each in fields(self)} | {"contact": self.judged_contact, "units": self.display_units},
            Path(path),
        )
        return Path(path)

    def settings(self) -> dict[str, Any]:
        """Return every key of the scene file with its value in SI: `duration`, `plant.BitRock.weight`, `controllers.soft torque.reference`."""
        return saving.flat({each.name: getattr(self, each.name) for each in fields(self)} | {"contact": self.element})

    def __str__(self) -> str:
        lines = [
            self.title,
            f"  {' + '.join(type(part).__name__ for part in self.parts)}, {self.duration:g} s, judged by {self.judged_names}",
        ]
        for case in self.cases:
            law = "no law" if case.law is None else type(case.law).__name__
            every = (
                "" if case.sample_time is None else f", every {case.sample_time:g} s" + (f", {case.delay:g} s late" if case.delay else "")
            )
            lines.append(f"  {case.label}: {law}{every}")
        return "\n".join(lines)

    def plant(self) -> HybridSystem:
        """Return the composed plant with the declared parameters. Results about this plant are shown in the units of the scene file."""
        return self._plant

    @cached_property
    def _plant(self) -> HybridSystem:
        plant = compose(*self.parts)
        plant.typed_units = self.display_units
        return plant

    @cached_property
    def _loops(self) -> dict[str, ClosedLoop]:
        return {}

    def __getitem__(self, label: str) -> ClosedLoop:
        """The closed loop of one case, which every verb takes, with what is judged of it; it is closed once.

        Raises SceneError where there is no case of that label, and for a number of a law that does not exist.
        """
        if label not in self._loops:
            case = self.case(label)
            inputs = {
                name: value.build() if isinstance(value, Waveform) else value for name, value in {**self.inputs, **case.inputs}.items()
            }
            own = {name: value for name, value in self.parameters.items() if self.plant().has_parameter(name)}
            loop = ClosedLoop(
                self.plant(), laws_of(case.controller, None), inputs, own, self.start, case.label, duration=self.duration, accuracy=self.accuracy,
                **{name: getattr(self, name) for name in keys.names("[verdict]")},
            )  # fmt: skip
            others = {k: v for k, v in self.parameters.items() if k not in own}
            loop = loop.with_parameters(others) if others else loop
            known = set_point(loop.system, self.signal)
            follows = (
                known is not None and loop.number(known).value == self.reference
            )  # where the set-point varies, what is judged varies with it
            self._loops[label] = loop.replace(reference=known if follows else self.reference)
        return self._loops[label]

    def __getstate__(self) -> dict[str, Any]:
        return {each.name: getattr(self, each.name) for each in fields(self)}

    @property
    def display_units(self) -> dict[str, str]:
        """Units for display, as {SI unit: unit}, such as {"rad/s": "rpm"}.

        If a number of the scene was given as text with a unit, such as reference="60 rpm", results in the same SI unit are
        shown in the unit of this text. The field `units` overrides these units.
        """
        laws = tuple(case.law for case in self.cases)
        inputs = (self.inputs, *(case.inputs for case in self.cases))
        typed = asked_units(self.reference, self.standstill_speed, inputs, self.parameters, self.start, fields=(laws, self.parts))
        return {**typed, **self.units}

    def run(self, label: str) -> Trajectory:
        """Simulate one case of the scene and return its run.

        Raises the errors of `simulate`, and SceneError if the label is unknown.

        Parameters
        ----------
        label
            Label of the case, such as "soft torque".
        """
        return simulate(self[label])

    @property
    def judged_contact(self) -> str:
        """Name of the contact whose stick phases are counted: the field `element`. Raises SceneError if the plant has
        no contact that can stick.
        """
        if self.element is None:
            raise SceneError("Argument `plant` must have a contact that can stick, but it has none.")
        return self.element

    @property
    def judged_names(self) -> str:
        """Text with the name of the contact whose stick phases are counted and of the signal that is evaluated."""
        return " and ".join(f"`{name}`" for name in (self.element, self.signal) if name is not None)

    @property
    def metrics(self) -> dict[str, tuple[str, ...]]:
        """Metrics of every run of the scene, as {metric: names of its signals and elements}."""
        stuck = {"stuck": (self.element,)} if self.element is not None else {}
        return {**stuck, "severity": (self.signal,), "peak": (self.effort,)}

    def dependencies(self, metrics: Mapping[str, Sequence[str]] | None = None) -> Dependencies:
        """Find the parts of the plant on which the metrics depend, under any of the controllers of the scene, and the
        cost of the parts on which no metric depends.

        Parameters
        ----------
        metrics
            {metric: names of the signals and elements that it reads}. By default the metrics of the verdict.

        Returns
        -------
        Dependencies
            For each part, the metrics that depend on it.

        Raises
        ------
        SceneError
            If a name is unknown.
        """
        from toolbox.modelling.dependencies import Dependencies, Dependency, dependencies_of

        asked = self.metrics if metrics is None else metrics
        found = [dependencies_of(self[label].system, asked, len(self.parts)) for label in self.labels]
        parts = tuple(
            Dependency(
                same[0].part, same[0].states, same[0].elements, tuple(name for name in asked if any(name in need.metrics for need in same))
            )
            for same in zip(*(each.parts for each in found), strict=True)
        )
        return Dependencies(parts, min(each.idle for each in found))

    def check(self) -> None:
        """Raise SceneError unless every case can be simulated and the signals and contacts of the scene exist. This
        check compiles nothing.
        """
        plant = self.plant()
        number("duration", self.duration, "s", above=0)
        contacts = [element.name for element in plant.elements]
        if self.element is not None and self.element not in contacts:
            raise SceneError(f"There is no element `{self.element}` to be judged: {suggest(self.element, contacts)}")
        for name in (self.signal, self.effort):
            plant.signal_unit(name)
            if name in plant.signals and plant.signals[name][0].numel() > 1:
                raise SceneError(f"Argument `verdict` must name scalars, but `{name}` has several entries: choose one, e.g. `{name}.0`.")
        number("verdict.after", self.after, "s", at_least=0, below=self.duration)
        self._check_cases()
        for name, value in self.start.items():
            place_start(plant, np.zeros(plant.x.numel()), name, value)
        for label in self.labels:
            try:
                Request(self[label], self.duration, accuracy=self.accuracy).checked()
            except SceneError as error:
                raise SceneError(f"Controller `{label}`: {error}") from None
            for note in self._without_effect(label):
                LOG.warning("controller `%s`: %s", label, note)

    def _without_effect(self, label: str) -> list[str]:
        """What is said of numbers of a law that an input takes the place of; the set-point of the scene, which only judges then, is none."""
        loop = self[label]
        return [
            f"the parameter `{name}` has no effect: {why_without_effect(loop, taking)}."
            for name, taking in loop.overriding_inputs.items()
            if name not in loop.plant.parameters and loop.number(name).value != self.reference
        ]
