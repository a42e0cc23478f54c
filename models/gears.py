"""Networks of planetary gear trains: shafts, trains and what is joined to them, in steady running and in motion.

A train has three shafts a, b and the carrier c. With the basic ratio i0 = w_a / w_b at a standing carrier and the efficiency eta of the teeth,

    w_a - i0 w_b - (1 - i0) w_c = 0,      T_a : T_b : T_c = 1 : -i0 eta^s : -(1 - i0 eta^s),      s = sgn(T_a (w_a - w_c))

(T: torque of a shaft on the train; s: whether power flows from a to b as seen from the carrier). Source: N. Polder, network theory of epicyclic gear trains
(1978); the equations are those of Willis and of power balance. A ring gear has i0 < 0, a pair of external gears in series i0 > 0.

Why tooth friction is set-valued: eta^s jumps where the teeth come to rest on each other. With eta = exp(-h), tau the torque of the teeth on the side of b,

    T_a = tau eta^-s  =  tau cosh h - F,      F = -sgn(w_a - w_c) |tau| sinh h  in slip,      |F| <= |tau| sinh h  at rest

is the same law without a jump to be guarded: F is dry friction whose load is the torque that the teeth transmit. At rest the ratio T_a / tau lies anywhere
between eta and 1 / eta, as it does in a machine. tau must not depend on F, so each train has the elasticity of its teeth; a stiff one changes nothing else.
A gearbox also has a friction that no load causes, its idle torque (bearings, seals). Without one, unloaded teeth at rest would have the bound 0 and
nothing to hold them against a torque that grows from 0, so the parts ask for it.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from models.friction import Coulomb
from toolbox import Component, DryFriction, Equations, SceneError, quantity, state
from toolbox.authoring import columns, entries, number
from toolbox.modelling import OptionalQuantities, Quantities

GROUND = "ground"
"""Name of the shaft that stands still."""

_TEETH = Coulomb(static=1.0, kinetic=1.0)


@dataclass(frozen=True)
class Train:
    """A planetary train by the names of its shafts: w_a - i0 w_b - (1 - i0) w_carrier = 0, `ratio` i0, `efficiency` of its teeth 0 < eta <= 1.

    Trains that name the same shaft share it. Raises SceneError for numbers and names that make no train.
    """

    a: str
    b: str
    carrier: str
    ratio: float
    efficiency: float = 1.0

    def __post_init__(self):
        _check_train((self.a, self.b, self.carrier), self.ratio)
        number("efficiency", self.efficiency, above=0, at_most=1)


@dataclass(frozen=True)
class SteadyGears:
    """Steady running of a network: speed [rad/s], torque [N m] put in from outside and power [W] put in, by name of shaft; print it for the table.

    imposed_speeds, imposed_torques: names of the shafts whose speed (torque) was given;  speed_gain, torque_gain: how all speeds (torques) follow
    from them, shape (shafts, given);  direction: s of every train, 0 where its teeth rest on each other.
    """

    speed: dict[str, float]
    torque: dict[str, float]
    imposed_speeds: tuple[str, ...]
    imposed_torques: tuple[str, ...]
    speed_gain: np.ndarray
    torque_gain: np.ndarray
    direction: tuple[int, ...]

    @property
    def power(self) -> dict[str, float]:
        """Power that each shaft puts in [W]; negative for a shaft that takes power out."""
        return {name: self.torque[name] * self.speed[name] for name in self.speed}

    @property
    def efficiency(self) -> float:
        """Power out divided by power in [1]; nan if no power flows."""
        power = np.array(list(self.power.values()))
        put_in = power[power > 0].sum()
        return float(-power[power < 0].sum() / put_in) if put_in > 0 else float("nan")

    def responsivity(self, of: str, to: str) -> float:
        """Logarithmic sensitivity of the power of the shaft `of` to the torque, or the speed, that is imposed on the shaft `to` [1].

            d ln T_of / d ln T_to where a torque is imposed,   d ln w_of / d ln w_to where a speed is;   everything else imposed stays

        Speeds do not depend on torques, nor torques on the size of speeds, so each is the sensitivity of the power as well; over all
        imposed torques (speeds) they add up to 1. This reading of Polder's term is ours. Raises SceneError for an unknown shaft, and for
        `of` without torque (speed).
        """
        for name in (of, to):
            _known(name, self.speed)
        by_torque = to in self.imposed_torques
        imposed, gain, value, word = (
            (self.imposed_torques, self.torque_gain, self.torque, "torque")
            if by_torque
            else (self.imposed_speeds, self.speed_gain, self.speed, "speed")
        )
        if value[of] == 0.0:
            raise SceneError(f"Argument `of` must be a shaft with a {word}, because a logarithm is asked for, but `{of}` has none.")
        row, column = list(self.speed).index(of), imposed.index(to)
        return float(gain[row, column] * value[to] / value[of])

    def __str__(self) -> str:
        head = ("shaft", "speed [rad/s]", "torque [N m]", "power [W]")
        rows = [(name, *(f"{each:.6g}" for each in (self.speed[name], self.torque[name], power))) for name, power in self.power.items()]
        return "\n".join([*columns([head, *rows], indent=""), f"efficiency {self.efficiency:.6g}"])


def steady_gears(
    trains: Sequence[Train],
    speeds: Mapping[str, float],
    torques: Mapping[str, float] | None = None,
    joined: Sequence[tuple[str, str]] = (),
) -> SteadyGears:
    """Speeds and torques of a network of trains that runs steadily.

    speeds: {shaft: imposed speed [rad/s]}, one for each degree of freedom;  torques: {shaft: torque put in from outside [N m]} on other shafts, 0 on those not
    named;  joined: pairs of shafts that turn together. The shaft "ground" stands still. The speeds follow from the trains alone; the torques from
    the balance of every train and shaft, with the directions of power that agree with the torques found.

    Raises SceneError where the imposed speeds are too few, too many or contradict each other, where trains repeat each other, and where no
    direction of power, or more than one, agrees with the torques (a network that locks itself).
    """
    if not trains:
        raise SceneError("Argument `trains` must hold at least one train, but it is empty.")
    names = list(dict.fromkeys(name for group in (*((t.a, t.b, t.carrier) for t in trains), *joined) for name in group))
    speeds, torques = _imposed(names, speeds, torques)
    relations = _relations(trains, joined, names, (0,) * len(trains))
    freedom = len(names) - np.linalg.matrix_rank(relations)
    if freedom > len(names) - len(relations):
        raise SceneError(
            "Argument `trains` must hold independent trains and joints, but one follows from the others: its torque would be arbitrary."
        )
    if len(speeds) != freedom:
        still = GROUND in names
        raise SceneError(
            f"Argument `speeds` must fix {freedom - still} of the shafts {', '.join(name for name in names if name != GROUND)}, one for each degree of "
            f"freedom, but it fixes {len(speeds) - still}."
        )
    free = tuple(name for name in names if name not in speeds)
    inner, outer = [names.index(name) for name in free], [names.index(name) for name in speeds]
    if np.linalg.matrix_rank(relations[:, inner]) < len(inner):
        direction = np.linalg.svd(relations[:, inner])[2][-1]
        loose = ", ".join(f"`{name}`" for name, part in zip(free, direction, strict=True) if abs(part) > 1e-9)
        raise SceneError(
            f"Argument `speeds` must determine every speed, but {loose} stay free, while {', '.join(speeds)} depend on each other."
        )
    speed_gain = np.zeros((len(names), len(outer)))
    speed_gain[outer, range(len(outer))] = 1.0
    speed_gain[inner] = -np.linalg.solve(relations[:, inner], relations[:, outer])
    speed = speed_gain @ np.array(list(speeds.values()), float)

    slip = np.array([speed[names.index(train.a)] - speed[names.index(train.carrier)] for train in trains])
    slip[np.abs(slip) <= 1e-12 * np.abs(speed).max()] = 0.0
    load = np.array([torques.get(name, 0.0) for name in free], float)
    noise = 1e-12 * np.abs(load).max(initial=0.0)
    carried, torque_gain = _balance(trains, lambda signs: _relations(trains, joined, names, signs), inner, slip, load, noise)
    return SteadyGears(
        speed=dict(zip(names, speed.tolist(), strict=True)),
        torque=dict(zip(names, (torque_gain @ load).tolist(), strict=True)),
        imposed_speeds=tuple(speeds),
        imposed_torques=free,
        speed_gain=speed_gain,
        torque_gain=torque_gain,
        direction=tuple(int(s) for s in np.sign(np.where(np.abs(carried) > noise, carried, 0.0) * slip)),
    )


def _imposed(
    names: Sequence[str], speeds: Mapping[str, float], torques: Mapping[str, float] | None
) -> tuple[dict[str, float], dict[str, float]]:
    """(speeds, torques) that are imposed on shafts, the ground at rest among them; raises SceneError where they contradict each other."""
    speeds, torques = dict(speeds), dict(torques or {})
    for word, given in (("speeds", speeds), ("torques", torques)):
        for name, value in given.items():
            _known(name, names)
            if not np.isfinite(value):
                raise SceneError(f"Argument `{word}` must hold finite numbers, but `{name}` is {value!r}.")
    if GROUND in names:
        if speeds.get(GROUND, 0.0) != 0.0 or GROUND in torques:
            raise SceneError(f"The shaft `{GROUND}` must stand still and takes any torque: leave it out of `speeds` and `torques`.")
        speeds[GROUND] = 0.0
    both = sorted(set(speeds) & set(torques))
    if both:
        raise SceneError(f"The shaft `{both[0]}` must have its speed or its torque imposed, but it has both.")
    return speeds, torques


def _balance(
    trains: Sequence[Train],
    relations: Callable[[Sequence[int]], np.ndarray],
    inner: Sequence[int],
    slip: np.ndarray,
    load: np.ndarray,
    noise: float,
) -> tuple[np.ndarray, np.ndarray]:
    """(torque of every train, torque on every shaft by torque put in) with the only directions of power that agree with the torques.

    relations: of the directions;  inner: numbers of the shafts whose speed follows;  slip: of every train against its carrier;  load: torques put in;
    noise: what counts as no torque. Raises SceneError where no direction agrees, or more than one.
    """
    found: list[tuple[np.ndarray, np.ndarray]] = []
    for guess in itertools.product(
        *[(1, -1) if v != 0.0 and train.efficiency < 1.0 else (0,) for v, train in zip(slip, trains, strict=True)]
    ):
        balance = relations(guess)
        if np.linalg.matrix_rank(balance[:, inner]) < len(inner):
            continue  # on the edge of locking itself
        share = np.linalg.solve(balance[:, inner].T, np.eye(len(inner)))  # torque of every train by torque put in
        carried = share[: len(trains)] @ load
        agrees = all(s * t * np.sign(v) >= -noise for s, t, v in zip(guess, carried, slip, strict=True))
        if agrees and not any(np.allclose(carried, other, rtol=1e-9, atol=noise) for other, _ in found):
            found.append((carried, balance.T @ share))
    if len(found) != 1:
        why = "more than one direction of power agrees" if found else "no direction of power agrees"
        raise SceneError(
            f"The network must be able to run as asked, but {why} with its torques, because it locks itself: drive it from another shaft."
        )
    return found[0]


@dataclass(frozen=True)
class GearNetwork(Component):
    """Inertias joined by elastic shafts and planetary gear trains, with dry friction of the teeth.

        J_i w_i' = T_i - sum of torques on shafts and trains
        shaft (i, j):     twist' = w_i - w_j,                        torque k twist + c twist' from i to j
        train (a, b, c):  windup' = w_a - i0 w_b - (1 - i0) w_c,     tau = k_m windup + c_m windup'
                          T_a = tau eta^-s,   T_b = -i0 tau,   T_c = -(T_a + T_b)

    T_i is the torque on node i from outside. T_a, T_b and T_c are the torques of the nodes on the train. i0 is the ratio
    w_a / w_b with a carrier c at rest, eta the efficiency of the teeth, and s = sgn(T_a (w_a - w_c)) the direction of the
    power through the teeth, as seen from the carrier: s = +1 if it flows from a to b, and s = -1 if it flows from b to a.

    Structure, by names of nodes:

    - `nodes`: names of the inertias.
    - `trains`: (a, b, carrier) of every train.
    - `shafts`: (first, second) of every shaft.
    - The node "ground" does not move. Any other name that is not in `nodes` is a node of another part, which must give
      `<name>.speed` and take `<name>.torque`.

    Numbers:

    - `inertia` J_i [kg m2] of every node.
    - `ratio` i0 [1], `mesh_stiffness` k_m [N m/rad] and `mesh_damping` c_m [N m s/rad] of every train. For lossy teeth
      also `efficiency` eta [1] and `idle_torque` [N m], the friction of the train without load. If both are None, the
      teeth have no loss and no contact.
    - `stiffness` k [N m/rad] and `damping` c [N m s/rad] of every shaft.

    Signals:

    - Needs `<node>.torque` T [N m] (default 0).
    - Gives `<node>.speed` w [rad/s].
    - States: `gears.speed`, `gears.windup`, `gears.twist`.
    - Contacts: `gears.i` of train i, with lossy teeth. It is dry friction with the slip w_a - w_c and a load that is
      proportional to |tau|.

    `input_node` is the node that acts as top drive for controllers: their `top.torque` and `top.speed` are the torque and
    the speed of this node.

    Range of validity: no backlash. Two lossy trains with the same a and the same carrier would share one slip; they
    raise an error. The default values are examples without a source.

    Examples
    --------
    >>> from models import GearNetwork
    >>> from toolbox import compose
    >>> print(compose(GearNetwork()))
    HybridSystem(GearNetwork): 3 states (gears.speed, gears.windup); contacts: none; inputs: sun.torque [N m], carrier.torque [N m]
    """

    nodes: tuple[str, ...] = ("sun", "carrier")
    inertia: Quantities = quantity((1.0, 10.0), "kg m2", "inertia of every node", above=0)
    trains: tuple[tuple[str, ...], ...] = (("sun", "ground", "carrier"),)
    ratio: Quantities = quantity((-3.0,), "1", "basic ratio i0 of every train")
    mesh_stiffness: Quantities = quantity((1e5,), "N m/rad", "stiffness of the teeth of every train, seen from a", above=0)
    mesh_damping: Quantities = quantity((50.0,), "N m s/rad", "damping of the teeth of every train, seen from a", at_least=0)
    efficiency: OptionalQuantities = quantity(None, "1", "efficiency of the teeth of every train", above=0, at_most=1)
    idle_torque: OptionalQuantities = quantity(None, "N m", "friction of every train without load, on a", above=0)
    shafts: tuple[tuple[str, ...], ...] = ()
    stiffness: OptionalQuantities = quantity(None, "N m/rad", "stiffness of every shaft", above=0)
    damping: OptionalQuantities = quantity(None, "N m s/rad", "damping of every shaft", at_least=0)
    input_node: str | None = None

    def check(self):
        for field in ("nodes", "trains", "shafts"):
            if not isinstance(getattr(self, field), tuple):
                raise SceneError(f"Argument `gears.{field}` must be a tuple of names, but it is {getattr(self, field)!r}.")
        for node in self.nodes:
            if not (isinstance(node, str) and node.isidentifier()) or node == GROUND or self.nodes.count(node) > 1:
                raise SceneError(f"Argument `gears.nodes` must hold different words other than `{GROUND}`, but one is {node!r}.")
        if not self.nodes:
            raise SceneError("Argument `gears.nodes` must hold at least one inertia, but it is empty.")
        if not self.trains:
            raise SceneError("Argument `gears.trains` must hold at least one train, but it is empty.")
        if self.input_node is not None and self.input_node not in self.nodes:
            raise SceneError(f"Argument `gears.input_node` must be one of {', '.join(self.nodes)}, but it is {self.input_node!r}.")
        self._check_sizes()
        for train, ratio in zip(self.trains, self.ratio, strict=True):
            _check_train(train, ratio)
        for shaft in self.shafts:
            if len(shaft) != 2 or shaft[0] == shaft[1] or not all(isinstance(name, str) for name in shaft):
                raise SceneError(f"Argument `gears.shafts` must hold pairs of different nodes, but one is {shaft!r}.")
        loose = sorted({*self.nodes}.difference(*self.trains, *self.shafts), key=self.nodes.index)
        if loose:
            raise SceneError(f"Argument `gears.nodes` must hold only what a train or a shaft touches, but nothing touches `{loose[0]}`.")

    def _check_sizes(self) -> None:
        """Raise SceneError where numbers are not given once for each node, train or shaft."""
        for field, size, of in (
            ("inertia", len(self.nodes), "nodes"),
            ("ratio", len(self.trains), "trains"),
            ("mesh_stiffness", len(self.trains), "trains"),
            ("mesh_damping", len(self.trains), "trains"),
            ("efficiency", len(self.trains), "trains"),
            ("idle_torque", len(self.trains), "trains"),
            ("stiffness", len(self.shafts), "shafts"),
            ("damping", len(self.shafts), "shafts"),
        ):
            given = getattr(self, field)
            if given is None and (
                size == 0 or (self.efficiency is None and self.idle_torque is None and field in ("efficiency", "idle_torque"))
            ):
                continue
            entries(f"gears.{field}", given or (), size, f", one for each of `gears.{of}`")

    @property
    def redirected_signals(self) -> Mapping[str, str]:
        """{"top.torque": "<input_node>.torque", "top.speed": "<input_node>.speed"}: a controller of a top drive acts on
        this node. Empty if `input_node` is None.
        """
        return {} if self.input_node is None else {"top.torque": f"{self.input_node}.torque", "top.speed": f"{self.input_node}.speed"}

    def steady(self, speeds: Mapping[str, float], torques: Mapping[str, float] | None = None) -> SteadyGears:
        """Compute the steady state of the network with rigid shafts and teeth. The field `idle_torque` counts as 0.

        Parameters
        ----------
        speeds
            {node: imposed speed [rad/s]}, one for each degree of freedom.
        torques
            {node: external torque [N m]} on nodes without an imposed speed. 0 for nodes that are left out, by default
            for all.

        Returns
        -------
        SteadyGears
            Speed, torque and power of every node. It prints as a table.

        Raises
        ------
        SceneError
            If the imposed speeds are too few, too many or contradict each other, or if no direction of the power
            through the teeth, or more than one direction, agrees with the torques (a network that locks itself).
        """
        efficiencies = self.efficiency or (1.0,) * len(self.trains)
        trains = [Train(a, b, c, ratio, eta) for (a, b, c), ratio, eta in zip(self.trains, self.ratio, efficiencies, strict=True)]
        return steady_gears(trains, speeds, torques, [(first, second) for first, second in self.shafts])

    def equations(self, signal):
        n = len(self.nodes)
        speed, windup = state("gears.speed", "rad/s", n), state("gears.windup", "rad", len(self.trains))
        twist = state("gears.twist", "rad", len(self.shafts)) if self.shafts else None
        everyone = dict.fromkeys([*self.nodes, *(name for group in (*self.trains, *self.shafts) for name in group)])
        outside = [name for name in everyone if name not in self.nodes and name != GROUND]
        w = (
            {name: speed[i] for i, name in enumerate(self.nodes)}
            | {name: signal(f"{name}.speed", "rad/s") for name in outside}
            | {GROUND: ca.SX(0)}
        )
        torque = {name: signal(f"{name}.torque", "N m", default=0.0) for name in self.nodes} | dict.fromkeys([*outside, GROUND], ca.SX(0))
        supplies = {f"torque on {name}": torque[name] * w[name] for name in self.nodes}
        stored, losses, contacts, windup_rates, twist_rates = ca.SX(0), {}, [], [], []
        for i, (a, b, c) in enumerate(self.trains):
            rate = w[a] - self.ratio[i] * w[b] - (1 - self.ratio[i]) * w[c]
            tau = self.mesh_stiffness[i] * windup[i] + self.mesh_damping[i] * rate
            t_a = tau
            if self.efficiency is not None:
                forth, friction = tooth_friction(f"gears.{i}", w[a] - w[c], tau, self.efficiency[i], self.idle_torque[i])
                t_a = forth - friction.force
                contacts.append(friction)
                losses[f"teeth {i}"] = (t_a - tau) * (w[a] - w[c])
            t_b = -self.ratio[i] * tau
            for name, t in ((a, t_a), (b, t_b), (c, -(t_a + t_b))):
                torque[name] -= t
            windup_rates.append(rate)
            stored += self.mesh_stiffness[i] * windup[i] ** 2 / 2
            losses[f"mesh {i}"] = self.mesh_damping[i] * rate**2
        for i, (first, second) in enumerate(self.shafts):
            rate = w[first] - w[second]
            t = self.stiffness[i] * twist[i] + self.damping[i] * rate
            torque[first] -= t
            torque[second] += t
            twist_rates.append(rate)
            stored += self.stiffness[i] * twist[i] ** 2 / 2
            losses[f"shaft {i}"] = self.damping[i] * rate**2
        pushes = [torque[name] / inertia for name, inertia in zip(self.nodes, self.inertia, strict=True)]
        flow = {speed: ca.vertcat(*pushes), windup: ca.vertcat(*windup_rates)}
        if twist is not None:
            flow[twist] = ca.vertcat(*twist_rates)
        supplies |= {name: -torque[name] * w[name] for name in outside}
        return Equations(
            flow=flow,
            outputs={f"{name}.speed": (w[name], "rad/s") for name in self.nodes}
            | {f"{name}.torque": (torque[name], "N m") for name in outside},
            elements=contacts,
            stored=stored + ca.dot(ca.vertcat(*self.inertia), speed**2) / 2,
            losses=losses,
            supplies=supplies,
        )


def tooth_friction(name: str, slip: ca.SX, torque: ca.SX, efficiency: ca.SX, idle: ca.SX) -> tuple[ca.SX, DryFriction]:
    """Teeth of efficiency eta that pass on `torque` tau [N m]: the torque that drives them is tau (1/eta + eta)/2 - F.

    Returns tau (1/eta + eta)/2 and the contact with force F, |F| = |tau| (1/eta - eta)/2 + idle in slip, so that (without idle torque) the driving torque is
    tau/eta while power flows towards tau, tau eta while it flows back, and anything between at rest. slip: of the driving side [rad/s]; tau must not
    depend on F.
    """
    load = ca.fabs(torque) * (1 / efficiency - efficiency) / 2 + idle
    contact = DryFriction(name, slip, _TEETH, load, slip_unit="rad/s", force_unit="N m")
    return torque * (1 / efficiency + efficiency) / 2, contact


def _relations(trains: Sequence[Train], joined: Sequence[tuple[str, str]], names: Sequence[str], direction: Sequence[int]) -> np.ndarray:
    """Torques of trains and joints on every shaft for unit torques on their first shaft; with direction 0 also the rows that hold for the speeds."""
    rows = np.zeros((len(trains) + len(joined), len(names)))
    for row, train, s in zip(rows, trains, direction, strict=False):
        passed = train.ratio * train.efficiency**s
        for name, factor in ((train.a, 1.0), (train.b, -passed), (train.carrier, passed - 1.0)):
            row[names.index(name)] += factor
    for row, (first, second) in zip(rows[len(trains) :], joined, strict=True):
        row[names.index(first)], row[names.index(second)] = 1.0, -1.0
    return rows


def _check_train(names: Sequence[str], ratio: float) -> None:
    if len(names) != 3 or len(set(names)) < 3 or not all(isinstance(name, str) and name for name in names):
        raise SceneError(f"A train must have three different shafts a, b and carrier, but it has {names!r}.")
    if not np.isfinite(ratio) or ratio in (0.0, 1.0):
        raise SceneError(f"Argument `ratio` must be a finite number other than 0 and 1 for ({', '.join(names)}), but it is {ratio!r}.")


def _known(name: str, names: Iterable[str]) -> None:
    if name not in names:
        raise SceneError(f"There is no shaft `{name}`: there are {', '.join(names)}.")
