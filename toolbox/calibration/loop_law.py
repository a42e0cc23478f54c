"""The law of one contact as functions of what was measured, made once for all plants of a structure: the windows of a log ask for it again and again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from toolbox.calibration.columnwise import Columnwise
from toolbox.errors import SceneError
from toolbox.modelling.hybrid_system import HybridSystem


@dataclass(frozen=True)
class LoopLaw:
    """Functions of (states, measured inputs, parameters, modes, direction of slip).

    law: slip, force in slip, force at break-away, sign of the force, and the slips at which the law breaks;  forces, slopes: force in slip, and its derivatives
    by the free parameters;  with_release: the same two, each with that at break-away behind it;  needs: rows of the states on which the law depends;
    ends: (parameters) -> friction at no slip, static bound, where all else is 1.
    """

    law: Columnwise
    forces: Columnwise
    slopes: Columnwise
    with_release: tuple[Columnwise, Columnwise]
    needs: tuple[int, ...]
    ends: ca.Function

    @staticmethod
    def of(plant: HybridSystem, place: int, output: str, given: Mapping[str, Any], measured: Sequence[str], free: Sequence[str]) -> LoopLaw:
        """The law of a contact by its place; output: the signal with its force;  given: inputs as numbers;  measured: names of the inputs that were;
        free: names of the free parameters.

        Raises SceneError where the force of another contact enters the signal, or an input that was not measured varies in time.
        """
        constants = {name: value for name, value in given.items() if name not in measured and name in plant.inputs}
        varying = next((name for name, value in constants.items() if not isinstance(value, (int, float))), None)
        if varying is not None:
            raise SceneError(f"Argument `{varying}` must be a number or be measured for a loop to be fitted, but it varies in time.")
        key = ("measured loop", place, output, tuple(sorted(constants.items())), tuple(measured), tuple(free))
        found: LoopLaw | None = plant.cache.get(key)
        if found is None:
            found = plant.cache[key] = _made(plant, place, output, constants, measured, free)
        return found


def _made(
    plant: HybridSystem, place: int, output: str, constants: Mapping[str, float], measured: Sequence[str], free: Sequence[str]
) -> LoopLaw:
    element: Any = plant.elements[place]
    force, expression = plant.F[place], plant.expression(output)
    others = [each.name for i, each in enumerate(plant.elements) if i != place and ca.depends_on(expression, plant.F[i])]
    if others or ca.depends_on(ca.jacobian(expression, force), force):
        raise SceneError(
            f"The signal `{output}` must hold the force of `{element.name}` alone, but that of `{others[0] if others else element.name}` enters it as well."
        )
    u = ca.SX.sym("measured", len(measured))
    inside = [u[measured.index(name)] if name in measured else constants.get(name, entry.default) for name, entry in plant.inputs.items()]
    gain, rest = ca.jacobian(expression, force), ca.substitute(expression, force, 0)
    side = ca.SX.sym("side")
    law: list[Any] = [element.slip, rest - gain * element.mode * element.kinetic, rest - gain * side * element.static]
    law += [-gain * side, ca.vertcat(*[twin.high for twin in element.breaks])]
    law = [ca.substitute(each, plant.u, ca.vertcat(*inside) if inside else ca.SX(0, 1)) for each in law]
    whole = ca.vertcat(*law)
    of_free = ca.vertcat(*[plant.p[plant._parameter(name).offset] for name in free])
    symbols = [plant.x, u, plant.p, plant.m, side]
    slopes = [ca.densify(ca.jacobian(each, of_free)) for each in law[1:3]]

    def function(*results: ca.SX) -> Columnwise:
        return Columnwise(ca.Function("law", symbols, list(results)))

    ends = ca.vertcat(element.load * element.law.sliding(ca.SX(0), *[0] * len(element.breaks)), element.static)
    ends = ca.substitute(ends, plant.u, ca.SX.ones(plant.u.numel()))
    beside = [each for each in ca.symvar(ends) if not ca.depends_on(plant.p, each)]
    ends = ca.substitute(ends, ca.vertcat(*beside), ca.SX.ones(len(beside)))
    return LoopLaw(
        law=function(*law), forces=function(law[1]), slopes=function(slopes[0]), with_release=(function(*law[1:3]), function(*slopes)),
        needs=tuple(row for row in range(plant.x.numel()) if ca.depends_on(whole, plant.x[row])), ends=ca.Function("ends", [plant.p], [ends]),
    )  # fmt: skip


def jumps(law: LoopLaw, plant: HybridSystem) -> bool:
    """Whether the force drops at release: then release is sharp, and the force before it is the static bound; else slip itself tells the bound."""
    away = plant.values * (1 + 0.1 * np.cos(np.arange(plant.values.size)))
    kinetic, static = np.array(law.ends(away)).ravel()
    return bool(abs(static - kinetic) > 1e-12 * abs(static))
