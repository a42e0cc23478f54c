"""The linear models that laws and observers are designed on: the string without its rock, and around sliding at a set-point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from toolbox import HybridSystem, SceneError, compose, linearise


@dataclass(frozen=True)
class StringModel:
    """x' = A x + B u - E T: a string under the top torque u and the torque T on its bit, which is left free.

    states: names of the entries of x;  top, bit: rows of the speeds;  load: row c with c x the torque of the string on the top drive.
    """

    A: np.ndarray
    B: np.ndarray
    E: np.ndarray
    states: tuple[str, ...]
    units: tuple[str, ...]
    top: np.ndarray
    bit: np.ndarray
    load: np.ndarray


def string_model(plant: HybridSystem) -> StringModel:
    """The matrices of a plant with `top.torque`, `top.speed`, `top.load`, `bit.speed` and the contact `bit`, whose own law is left out.

    Other friction along the string is left out as well, and so are actuators that stand between laws and string (parts with
    `redirected_signals`). Raises SceneError for a plant without these signals, and for one that is not linear.
    """
    plant = without_actuators(plant)
    for name in ("top.torque", "top.speed", "top.load", "bit.speed", "bit.force"):
        if not plant.has_signal(name):
            raise SceneError(f"The law is designed on a drill string with a rock, but the plant has no `{name}`.")
    if "bit" in plant.modeless:
        raise SceneError(
            f"The law is designed on a rock that sticks and slips, but the law of `bit`, {plant.modeless['bit']}, has a memory: give the rock its steady "
            "curve, such as Exponential()."
        )
    contact = next(i for i, element in enumerate(plant.elements) if element.name == "bit")
    outputs = ca.vertcat(*[plant.expression(name) for name in ("top.speed", "bit.speed", "top.load")])
    torque = plant.inputs["top.torque"].symbol
    slopes = [
        ca.jacobian(plant.flow, plant.x),
        ca.jacobian(plant.flow, torque),
        ca.jacobian(plant.flow, plant.F[contact]),
        ca.jacobian(outputs, plant.x),
    ]
    if ca.depends_on(ca.vertcat(*[ca.vec(slope) for slope in slopes]), ca.vertcat(plant.x, plant.u, plant.F, plant.t)):
        raise SceneError("The law is designed on a linear string, but the equations of this plant are not linear in its states.")
    names = [(name if size is None else f"{name}.{i}", unit) for name, (_, size, unit) in plant.states.items() for i in range(size or 1)]
    A, B, E, C = (np.array(ca.DM(matrix)) for matrix in ca.Function("slopes", [plant.p], [ca.densify(s) for s in slopes])(plant.values))
    return StringModel(A, B.ravel(), E.ravel(), tuple(name for name, _ in names), tuple(unit for _, unit in names), *C)


@dataclass(frozen=True)
class LumpedString:
    """A chain of inertias as one spring between two: all springs in series, and all inertias below the drive.

    drive, below: inertias [kg m2];  stiffness: of the springs in series [N m/rad];  drag: of the drive [N m s/rad].
    """

    drive: float
    below: float
    stiffness: float
    drag: float

    @property
    def impedance(self) -> float:
        """zeta = sqrt(k J) [N m s/rad]: torque at the top per speed of a bit that swings below a drive which does not."""
        return float(np.sqrt(self.stiffness * self.below))

    @property
    def frequency(self) -> float:
        """sqrt(k / J) [rad/s], of that swing."""
        return float(np.sqrt(self.stiffness / self.below))


def lumped_string(plant: HybridSystem, law: str, instead: str) -> LumpedString:
    """The lumped string of a plant with a chain of inertias. Raises SceneError with the name of the law and what may be given to it instead."""
    try:
        inertia, stiffness, drag = (plant.parameter(f"chain.{name}") for name in ("inertia", "stiffness", "top_drag"))
    except SceneError as error:
        raise SceneError(f"{law} is designed on a chain of inertias, or given {instead}: {error}") from None
    return LumpedString(float(inertia[0]), float(np.sum(inertia[1:])), 1.0 / float(np.sum(1.0 / stiffness)), float(drag))


def entries(matrix: np.ndarray) -> tuple[int, ...]:
    """Return the indices, counted row by row, of the nonzero entries of a matrix. A string of n elements has about 4 n of them."""
    return tuple(np.flatnonzero(matrix).tolist())


def with_entries(shape: tuple[int, int], places: Sequence[int], numbers: ca.SX | ca.DM) -> ca.SX:
    """The matrix with these numbers at these places, and zeros beside them that are not computed with; no places: all of them."""
    at = np.array(places, int) if places else np.arange(shape[0] * shape[1])
    turned = ca.Sparsity.triplet(*shape[::-1], (at % shape[1]).tolist(), (at // shape[1]).tolist())
    return ca.SX(turned, numbers).T  # casadi counts column by column


def rock_slope(plant: HybridSystem, speed: float) -> tuple[float, float]:
    """Torque [N m] of the rock at a bit speed [rad/s] > 0 on the declared plant, and its slope [N m s/rad]."""
    rock = next((element for element in plant.elements if element.name == "bit"), None)
    if rock is None:
        raise SceneError(
            "The law is designed on a drill string with a rock that sticks and slips, but the plant has no such contact `bit`."
        )
    place = ca.jacobian(rock.slip, plant.x)
    inputs = plant.input_defaults(plant.values)
    torque = ca.Function("rock", [plant.x, plant.u, plant.p, plant.m, plant.t], [rock.kinetic, ca.jacobian(rock.kinetic, plant.x)])
    row = np.array(ca.DM(place)).ravel()
    value, slope = torque(speed * row, inputs, plant.values, np.ones(len(plant.elements)), 0.0)
    return float(value), float(np.array(slope).ravel() @ row)


def rock_table(plant: HybridSystem) -> tuple[np.ndarray, np.ndarray]:
    """Speeds [rad/s] from 0, and the torque of the declared rock there; at 0 its bound."""
    rock = next(element for element in plant.elements if element.name == "bit")
    speeds = np.append(0.0, np.geomspace(1e-3, 100.0, 2000))
    row = np.array(ca.DM(ca.jacobian(rock.slip, plant.x))).ravel()
    function = ca.Function("rock", [plant.x, plant.u, plant.p, plant.m, plant.t], [rock.kinetic, rock.static])
    inputs, modes = plant.input_defaults(plant.values), np.ones(len(plant.elements))
    kinetic, static = function(row[:, None] * speeds[None, :], inputs, plant.values, modes, 0.0)
    torque = np.array(kinetic).ravel()
    torque[0] = float(np.array(static).ravel()[0])
    return speeds, torque


def drilling_point(plant: HybridSystem, speed: float) -> tuple[StringModel, np.ndarray, float, np.ndarray]:
    """(model, x, u, A) while the whole string turns at `speed` [rad/s] > 0: the states x, the torque u [N m], and A with the rock's slope in it.

    A is that of `toolbox.linearise` with the contact `bit` in slip+. Raises SceneError as `string_model` does.
    """
    plant = without_actuators(plant)
    model = string_model(plant)
    torque, _ = rock_slope(plant, speed)
    n = model.A.shape[0]
    # A x + B u = E T with top speed = speed
    matrix = np.vstack([np.column_stack([model.A, model.B]), np.append(model.top, 0.0)])
    solution = np.linalg.lstsq(matrix, np.append(model.E * torque, speed), rcond=1e-13)[0]
    x, u = solution[:n], float(solution[n])
    at = dict(zip(model.states, x, strict=True)) | {"top.torque": u}
    around = linearise(plant, at=at, mode={"bit": "slip+"}, inputs="top.torque", outputs="top.speed")
    return model, x, u, np.array(around.A)


def without_actuators(plant: HybridSystem) -> HybridSystem:
    """The plant as a law on `top.torque` and `top.speed` sees it, without the parts that stand between."""
    parts = [part for part in plant.parts if not part.redirected_signals]
    return plant if len(parts) == len(plant.parts) else compose(*parts)
