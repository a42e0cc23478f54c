"""A plant with regularised friction: what most of the literature simulates, with its width stated and its price known.

    F(v) = -load tanh(v/w) [mu(|v|) + b exp(-|v| / (2 w))],   |v| = v tanh(v/w)        w: the width, a slip speed

b = 0 is the plain form, whose peak lies below the static bound by a part that grows with the width. The matched form takes the b that makes the peak equal to
the bound, so that a contact breaks free where it should. Both creep where the set-valued contact sticks: under a force r times the bound by about
w atanh(r). For w -> 0 the motion is that of the set-valued law.

Why not the default: the creep and the slow passage of the peak make an error that falls with the width at best, while the equations become stiffer.

A smoothed contact is said to "stick" while |v| < 3 w, where the law has not yet reached its sliding branch, with a hysteresis of 10 percent. This mode is
only shown: no force depends on it.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from toolbox.arguments import number
from toolbox.errors import SceneError, suggest
from toolbox.modelling.elements import Element, FrictionLaw, Hysteresis
from toolbox.modelling.hybrid_system import HybridSystem, Parameter, checked_plant
from toolbox.modelling.two_directions import check_one_direction
from toolbox.vocabulary import new_names_only

STICKING = 3.0
"""Slip speed in widths below which a smoothed contact is shown as sticking."""


class Creep(Hysteresis):
    """Whether a smoothed contact creeps ("stick") or slides ("slip")."""

    mode_names: Mapping[int, str] = {0: "stick", 1: "slip"}

    def __init__(self, name: str, slip: ca.SX, width: ca.SX):
        super().__init__(name, (slip / (STICKING * width)) ** 2, 0.9**2, 1.1**2)

    def signals(self) -> dict[str, tuple[ca.SX, str]]:
        return {}


class SmoothSystem(HybridSystem):
    """A plant whose friction is regularised; `sharp` is the set-valued plant it stands for, `widths` {element: width}, `match_static_peak`
    whether the peak is the static bound."""

    sharp: HybridSystem
    widths: dict[str, float]
    match_static_peak: bool

    def with_parameters(self, values: Mapping[str, Any]) -> SmoothSystem:
        """The same plant with other parameter values, its peaks matched again."""
        return smoothed(self.sharp.with_parameters(values), self.widths, match_static_peak=self.match_static_peak)

    def __reduce__(self) -> Any:
        return partial(smoothed, match_static_peak=self.match_static_peak), (self.sharp, self.widths)


@new_names_only
def smoothed(plant: HybridSystem, width: float | Mapping[str, float], *, match_static_peak: bool = True) -> SmoothSystem:
    """Return a plant whose set-valued dry friction is replaced by a smooth function of the slip speed with a given width.

    The result can be simulated and linearised, and its `to_casadi` can be given to any other integrator. Switches of
    elastic contacts, and of controllers that switch, remain. The parameters `<element>.smoothing_width` and
    `<element>.smoothing_peak` of the result hold the width w and the peak b of the regularised friction.

    Parameters
    ----------
    plant
        The plant.
    width
        Slip speed within which friction rises to its peak, > 0, for all contacts and relays [m/s or rad/s]. Or
        {element: width}: elements that are left out keep their set-valued friction.
    match_static_peak
        Whether the peak of the regularised friction is the static friction, by default True. Otherwise the peak is the
        lower value that tanh gives.

    Returns
    -------
    SmoothSystem
        The plant with regularised friction.

    Raises
    ------
    SceneError
        If a width is not > 0, or the plant has a rigid unilateral contact.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, measure, simulate
    >>> from toolbox.modelling import smoothed
    >>> run = simulate(smoothed(compose(BlockOnBelt()), width=1e-3), "40 s")
    >>> print(f"{measure.extent(run, 'block.position', after='20 s').maximum:.3f} m")
    1.129 m
    """
    if isinstance(checked_plant(plant), SmoothSystem):
        raise SceneError(f"Argument `plant` must be a plant made by `compose`, but it is a {type(plant).__name__}.")
    if not isinstance(match_static_peak, bool):
        raise SceneError(f"Argument `match_static_peak` must be True or False, but it is {match_static_peak!r}.")
    widths = checked_widths(plant, width)
    template = plant.once(("smoothed", tuple(widths)), lambda: _smooth_structure(plant, list(widths)))
    made: SmoothSystem = copy.copy(template)
    made.parts, made.sharp, made.widths, made.match_static_peak = plant.parts, plant, widths, match_static_peak
    peaks = [_peak(plant, template, name, w) if match_static_peak else 0.0 for name, w in widths.items()]
    made.values = np.concatenate([plant.values, list(widths.values()), peaks])
    return made


def checked_widths(plant: HybridSystem, width: Any) -> dict[str, float]:
    """{element: width} of the elements that are to be smoothed; raises SceneError as `smoothed` does."""
    check_one_direction(plant.elements, "Smoothing", "simulate the plant with located events")
    holding = {element.name: element for element in plant.elements if element.holds}
    rigid = next((e.name for e in holding.values() if e.rigid), None)
    given = width if isinstance(width, Mapping) else dict.fromkeys(holding, width)
    for name in given:
        if name not in holding:
            raise SceneError(f"There is no friction or relay `{name}`: {suggest(name, holding)}")
        if holding[name].rigid:
            raise SceneError(f"The rigid contact `{rigid}` cannot be smoothed: give it a `stiffness` in place of a restitution.")
    return {name: number(f"width.{name}", given[name], holding[name].slip_unit, above=0) for name in holding if name in given}


def _smooth_structure(plant: HybridSystem, names: list[str]) -> SmoothSystem:
    """The system with widths and missing peaks as parameters behind those of the plant."""
    chosen = [element for element in plant.elements if element.name in names]
    widths, peaks = [ca.SX.sym(f"{e.name}.width") for e in chosen], [ca.SX.sym(f"{e.name}.peak") for e in chosen]
    old: list[ca.SX] = []
    new: list[ca.SX] = []

    def smooth(expression: ca.SX) -> ca.SX:
        return ca.substitute([ca.SX(expression)], old, new)[0] if old else ca.SX(expression)

    for element, w, b in zip(chosen, widths, peaks, strict=True):
        side = ca.tanh(element.slip / w)
        old.append(element.mode)
        new.append(side)
        near = ca.exp(-element.slip * side / (2 * w))
        force = -side * smooth(element.load) * (smooth(element.sliding) + b * near)
        old.append(element.multiplier)
        new.append(force)

    made = object.__new__(SmoothSystem)
    made.__dict__.update(plant.mapped(smooth).__dict__)
    creeping = {e.name: Creep(e.name, e.slip, w) for e, w in zip(chosen, widths, strict=True)}
    made.elements = tuple(creeping.get(element.name, element) for element in made.elements)
    made.F, made.m = (ca.vertcat(ca.SX(0, 1), *[getattr(e, word) for e in made.elements]) for word in ("multiplier", "mode"))
    made.p = ca.vertcat(plant.p, *widths, *peaks)
    made.parameters = dict(plant.parameters)
    first = plant.p.numel()
    for i, element in enumerate(chosen):
        for tail, offset, unit, meaning in (
            ("smoothing_width", first + i, element.slip_unit, "width of the smoothed law"),
            ("smoothing_peak", first + len(chosen) + i, "1", "what the plain form lacks to its peak"),
        ):
            made.parameters[f"{element.name}.{tail}"] = Parameter(f"{element.name}.{tail}", unit, meaning, None, offset, {})
    return made


def _peak(plant: HybridSystem, template: SmoothSystem, name: str, width: float) -> float:
    """b of the matched form for the numbers of a plant."""
    law = plant.element(name).law
    if law is None:
        return 0.0
    if law.reverse() is not law:
        raise SceneError(f"The peak of `{name}` is matched for a law that is the same both ways: smooth it with `match_static_peak=False`.")
    v, w = ca.SX.sym("v"), ca.SX.sym("w")
    pieces = _pieces(law, v, w)
    if ca.which_depends(ca.vertcat(*pieces), plant.x, 1, True).count(True):
        raise SceneError(
            f"The peak of `{name}` follows from the states, as of frictions on one slip: smooth it with `match_static_peak=False`."
        )
    function = template.once(("peak", name), lambda: ca.Function("peak", [v, w, plant.p], pieces))
    return missing_peak(lambda grid: function(grid[None, :], width, plant.values), width)


def _pieces(law: FrictionLaw, v: ca.SX, width: Any) -> list[ca.SX]:
    """The plain form of a law at a slip, what lifts its peak, and the bound at which the peak is to be."""
    smooth = ca.tanh(v / width)
    plain = smooth * law.sliding(v * smooth, *[ca.SX(0)] * len(law.break_speeds()))
    return [plain, smooth * ca.exp(-v * smooth / (2 * width)), ca.SX(law.breakaway())]


Regularisation = Callable[[Element], ca.SX]
"""The force of a contact as a smooth expression of its slip."""


@new_names_only
def regularised(width: float, match_static_peak: bool = True) -> Regularisation:
    """Describe smooth friction of a given width, for the argument `regularisation` of `Rollout`.

    Parameters
    ----------
    width
        Slip speed within which the force rises [unit of the slip].
    match_static_peak
        Whether the peak of the smooth friction is the static bound, by default True. Otherwise the peak is the lower
        value that tanh gives.

    Returns
    -------
    Regularisation
        The description.

    Examples
    --------
    >>> import numpy as np
    >>> from models import BitRock, wells
    >>> from toolbox import compose
    >>> from toolbox.authoring import Rollout, regularised
    >>> rollout = Rollout(compose(wells.JANSEN_2, BitRock()), ["top.torque"], 0.1, 20, regularised(0.1))
    >>> states, _ = rollout.states(np.array([15.0, 10.0, 10.0]), np.full((5, 1), 12e3))
    >>> print(states[-1].round(2))
    [15.34 10.13  8.83]
    """

    def force(element: Element) -> ca.SX:
        law = element.law
        if law is None or law.break_speeds() or law.reverse() is not law:
            raise SceneError(
                f"`{element.name}` cannot be regularised: that takes a contact whose law has no breaks and is the same both ways."
            )
        v = element.slip
        smooth = ca.tanh(v / width)
        speed = v * smooth
        near = ca.exp(-speed / (2 * width))
        missing = lacking(law, width) if match_static_peak else 0.0
        return -element.load * smooth * (law.sliding(speed) + missing * near)

    return force


def lacking(law: Any, width: float) -> Any:
    """Return b of the equation in the docstring of the module, for a law with numbers as fields. SceneError is raised if the fields are
    symbols."""
    v = ca.SX.sym("v")
    try:
        base = ca.Function("base", [v], _pieces(law, v, width))
    except RuntimeError:
        raise SceneError("The peak of a law is matched for numbers: give the law of the declared plant.") from None
    return missing_peak(base, width)


def missing_peak(base: Callable[[np.ndarray], Any], width: float) -> float:
    """b such that the peak of plain + b extra is the bound; base: speeds -> (plain, extra, bound)."""
    grid = np.linspace(1e-3, 30.0, 30_000) * width
    plain, extra, bound = (np.array(value).ravel() for value in base(grid))
    if not plain.max() < bound[0]:
        return 0.0
    low, high = 0.0, abs(float(bound[0])) or 1.0
    while (plain + high * extra).max() < bound[0]:
        high *= 2.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if (plain + middle * extra).max() < bound[0] else (low, middle)
    return 0.5 * (low + high)
