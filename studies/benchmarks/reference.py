"""Published stick-slip cases integrated by plain scipy, and two of them by heyoka.

Why a second integrator: a reference that shares code with what it checks proves nothing. Here is
nothing but `scipy.integrate.solve_ivp` (DOP853) between switches, and the switching rule:

    slip s:  F = -s F_k(|v|)          ends when s v falls to zero
    stick:   F = hold, so that v' = 0 ends when |hold| exceeds F_s, then s = -sgn hold
    at v = 0: stick if |hold| <= F_s, otherwise slip with s = -sgn hold

v is the slip speed, F the friction force in the direction of v, hold the force that keeps v constant.

Why the laws are continued past v = 0 (to s v = -0.1, -0.5 or -1, constant beyond): a step that
oversteps the event sees a smooth right-hand side.

Why a contact that has just switched is deaf for 1e-10 s: the release is located to a few ulp of time. If it
comes early by these, the slip first moves back, by less than round-off, and would stick at once.

Why samples are integrated, not interpolated: the interpolant of DOP853 has order 7, its steps order
8; at rtol 1e-13 it adds up to 1e-11. Switch times are found on it: a correction by short integrations
changed the error of the states by a tenth at most from rtol 1e-8 on (`chain_all`: up to eight times
smaller, 1e-10 instead of 8e-10 at rtol 1e-10), and cost 10 to 45 per cent more time.

Sources: Leine et al. 1998 (belt), Jansen and van den Steen 1995 with the bit law of Navarro-Lopez and
Cortes 2007 (rig), Larsson and Farhang 2016 (disks, a reconstruction); the chains, the weight on bit and
the gains of the PI are made for this study. All numbers SI. Modes at t = 0 follow from the rule and
are not listed among the switches.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import exp, sin
from time import perf_counter
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

MODES = {1: "slip+", 0: "stick", -1: "slip-"}
DEAF = 1e-10  # [s] for which a contact that has just switched does not switch again


class Switch(NamedTuple):
    """A contact changes its mode at a time [s]."""

    time: float
    contact: str
    before: str
    after: str


@dataclass(frozen=True)
class Reference:
    """States (nt, n) at times [s], the switches on the way, and the seconds of integration alone."""

    time: np.ndarray
    states: np.ndarray
    switches: tuple[Switch, ...]
    wall_time: float


@dataclass(frozen=True)
class Plant:
    """A mechanism with dry contacts; lists run over the contacts, modes are +1, 0, -1."""

    rate: Callable  # (t, y, modes) -> y'
    slip: Callable  # (y) -> slip speeds
    hold: Callable  # (t, y) -> forces that would keep the slip speeds constant
    static: list[float]  # static bounds
    stop: Callable  # (y, i) sets slip i exactly to zero, in place
    contacts: list[str]
    size: np.ndarray  # what each state is worth: atol = rtol * size
    max_step: float  # [s] short against the fastest motion, so that no event is stepped over
    start: list[float]
    period: float = np.inf  # [s] between samples
    sample: Callable | None = None  # (y) sets what is held until the next sample, in place


def simulate(plant: Plant, duration: float, rtol: float, output_times=None) -> Reference:
    """The motion of a plant from its start, sampled at the output times (ascending), or at its end."""
    settings = {"method": "DOP853", "rtol": rtol, "atol": rtol * plant.size, "max_step": plant.max_step}
    wanted = np.array([duration] if output_times is None else output_times, float)

    def rate(t, y):
        return plant.rate(t, y, modes)

    def margins(t, y):
        """What each contact has left before it switches: s v in slip, F_s - |hold| in stick."""
        terms = zip(modes, plant.slip(y), plant.hold(t, y), plant.static, strict=True)
        left = [s * v if s else bound - abs(force) for s, v, force, bound in terms]
        if t <= time + DEAF:
            for i in fresh:
                left[i] = 1.0
        return left

    def least_margin(t, y):
        return min(margins(t, y))

    least_margin.terminal, least_margin.direction = True, -1.0  # type: ignore[attr-defined]

    def mode_at_rest(i, may_stick=True):
        force = plant.hold(time, state)[i]
        return 0 if may_stick and abs(force) <= plant.static[i] else (-1 if force > 0 else 1)

    time, state, tick, asked, not_counted = 0.0, np.array(plant.start, float), 0, 0, 0.0
    modes = [int(np.sign(v)) or mode_at_rest(i) for i, v in enumerate(plant.slip(state))]
    fresh = {i for i, v in enumerate(plant.slip(state)) if v == 0}
    switches: list[Switch] = []
    rows: list[np.ndarray] = []
    began = perf_counter()
    while time < duration:
        end, first_step = duration, None
        if plant.sample:
            if time == tick * plant.period:
                plant.sample(state)
                tick += 1
            end = min(duration, tick * plant.period)
            first_step = min(end - time, plant.max_step)
        run = solve_ivp(rate, (time, end), state, events=least_margin, first_step=first_step, **settings)
        t, y = run.t, run.y
        left = margins(t[-1], y[:, -1])
        switching = [i for i, m in enumerate(left) if m <= 0 or m == min(left)] if run.status == 1 else []
        paused = perf_counter()
        last = np.searchsorted(wanted, t[-1], "right" if t[-1] == duration else "left")
        for at in wanted[asked:last]:
            k = np.searchsorted(t, at, "right") - 1
            h = min(at - t[k], plant.max_step)
            rows.append(solve_ivp(rate, (t[k], at), y[:, k], first_step=h, **settings).y[:, -1] if h else y[:, k])
        asked = last
        not_counted += perf_counter() - paused
        time, state, fresh = float(t[-1]), y[:, -1].copy(), set(switching)
        for i in switching:
            before = modes[i]
            plant.stop(state, i)
            modes[i] = mode_at_rest(i, may_stick=before != 0)
            switches.append(Switch(time, plant.contacts[i], MODES[before], MODES[modes[i]]))
    return Reference(wanted, np.array(rows), tuple(switches), perf_counter() - began - not_counted)


def chain_size(n):
    """What the n - 1 twists [rad] and n speeds [rad/s] of a chain are worth."""
    return np.r_[np.full(n - 1, 25.0 / (n - 1)), np.full(n, 10.0)]


SIZE = {  # what each state is worth: errors are quoted relative to it
    "belt": np.array([1.0, 1.0]),
    "rig": np.array([25.0, 10.0, 10.0, 10.0]),
    "two_disks": np.array([2.0, 0.02, 2.0]),
    "chain_bit": chain_size(10),
    "chain_all": chain_size(10),
    "sampled_rig": np.array([25.0, 10.0, 10.0]),
}


def belt(duration=100.0, rtol=1e-10, output_times=None, max_step=1.0, integrate=simulate) -> Reference:
    """Mass on a moving belt (Leine et al. 1998); states position x [m] and speed v [m/s].

    m x'' + k x = F,  F = -sgn(v_rel) F_s/(1 + delta |v_rel|),  v_rel = v - v_belt
    """
    m, k, F_s, delta, v_belt = 1.0, 1.0, 1.0, 3.0, 0.2

    def rate(t, y, modes):
        (x, v), s = y.tolist(), modes[0]
        if not s:
            return [v, 0.0]
        F = -s * F_s / (1 + delta * max(s * (v - v_belt), -0.1))
        return [v, (F - k * x) / m]

    def stop(y, i):
        y[1] = v_belt

    plant = Plant(rate, lambda y: [y[1] - v_belt], lambda t, y: [k * y[0]], [F_s], stop, ["belt"], SIZE["belt"], max_step, [0.0, 0.0])
    return integrate(plant, duration, rtol, output_times)


@dataclass(frozen=True)
class Rig:
    """Two-inertia drill string (Jansen and van den Steen) with the bit law of Navarro-Lopez."""

    J_r: float = 2122.0  # kg m2, table
    J_b: float = 374.0  # kg m2, bit
    k: float = 473.0  # N m/rad
    c_12: float = 23.2  # N m s/rad
    c_r: float = 425.0
    c_b: float = 50.0
    WR: float = 97000.0 * 0.155575  # N m, weight on bit times bit radius
    mu_s: float = 0.8
    mu_c: float = 0.5
    gamma: float = 0.9  # s/rad, over v_f = 1 rad/s
    Kp: float = 4000.0  # N m s/rad
    Ki: float = 1500.0  # N m/rad
    Om: float = 8.0  # rad/s, asked of the table

    def bit_torque(self, w, s):
        """T = s W R_b [mu_c + (mu_s - mu_c) exp(-gamma |w|)]"""
        decay = exp(-self.gamma * max(s * w, -1.0))
        return s * self.WR * (self.mu_c + (self.mu_s - self.mu_c) * decay)

    def accelerations(self, twist, w_r, w_b, u, s):
        """J_r w_r' = u - c_r w_r - T_string,  J_b w_b' = T_string - c_b w_b - T; w_b' = 0 stuck."""
        string = self.k * twist + self.c_12 * (w_r - w_b)
        bit = (string - self.c_b * w_b - self.bit_torque(w_b, s)) / self.J_b if s else 0.0
        return (u - self.c_r * w_r - string) / self.J_r, bit

    def hold(self, t, y):
        return [-(self.k * y[0] + self.c_12 * (y[1] - y[2]) - self.c_b * y[2])]

    def plant(self, rate, size, max_step, **sampling):
        def stop(y, i):
            y[2] = 0.0

        return Plant(rate, lambda y: [y[2]], self.hold, [self.WR * self.mu_s], stop, ["bit"], size, max_step, [0.0] * len(size), **sampling)


def rig(duration=100.0, rtol=1e-10, output_times=None, max_step=1.0, integrate=simulate) -> Reference:
    """Drill string under a continuous PI; states twist [rad], w_r, w_b [rad/s], z [rad].

    u = Kp e + Ki z,  z' = e = Om - w_r
    """
    p = Rig()

    def rate(t, y, modes):
        twist, w_r, w_b, z = y.tolist()
        table, bit = p.accelerations(twist, w_r, w_b, p.Kp * (p.Om - w_r) + p.Ki * z, modes[0])
        return [w_r - w_b, table, bit, p.Om - w_r]

    return integrate(p.plant(rate, SIZE["rig"], max_step), duration, rtol, output_times)


def sampled_rig(duration=120.0, period=0.01, rtol=1e-10, output_times=None, max_step=0.25) -> Reference:
    """Drill string under a sampled PI; states twist [rad], w_r, w_b [rad/s].

    At t_k = k period: u_k = Kp e_k + Ki z_k, held;  z_k+1 = z_k + period e_k,  e_k = Om - w_r(t_k)
    """
    p = Rig()

    def rate(t, y, modes):  # the held torque u and the integral z ride along as constant states
        twist, w_r, w_b, u, _ = y.tolist()
        table, bit = p.accelerations(twist, w_r, w_b, u, modes[0])
        return [w_r - w_b, table, bit, 0.0, 0.0]

    def sample(y):
        e = p.Om - y[1]
        y[3], y[4] = p.Kp * e + p.Ki * y[4], y[4] + period * e

    size = np.r_[SIZE["sampled_rig"], 1e4, 10.0]
    plant = p.plant(rate, size, max_step, period=period, sample=sample)
    run = simulate(plant, duration, rtol, output_times)
    return Reference(run.time, run.states[:, :3], run.switches, run.wall_time)


def two_disks(duration=3.0, rtol=1e-10, output_times=None, max_step=0.02) -> Reference:
    """Braking stop of a rotor on a sprung stator; states w1 [rad/s], th2 [rad], w2 [rad/s].

    I1 w1' = -T,  I2 w2' = T - k_t th2 - c_t w2,  w = w1 - w2
    T = sgn(w) N R [mu_k + (mu_s - mu_k) exp(-alpha |w|)]
    stick: w1' = w2' = -(k_t th2 + c_t w2)/(I1 + I2), while |T| <= mu_s N R
    """
    I1, I2, k_t, c_t, NR = 20.0, 0.02, 2000.0, 0.5, 1000.0 * 0.1
    mu_s, mu_k, alpha, w0 = 0.4, 0.3, 2.0, 2.0

    def rate(t, y, modes):
        (w1, th2, w2), s = y.tolist(), modes[0]
        spring = k_t * th2 + c_t * w2
        if not s:
            together = -spring / (I1 + I2)
            return [together, w2, together]
        T = s * NR * (mu_k + (mu_s - mu_k) * exp(-alpha * max(s * (w1 - w2), -0.5)))
        return [-T / I1, w2, (T - spring) / I2]

    def hold(t, y):
        return [-I1 / (I1 + I2) * (k_t * y[1] + c_t * y[2])]

    def stop(y, i):
        y[2] = y[0]

    plant = Plant(rate, lambda y: [y[0] - y[2]], hold, [mu_s * NR], stop, ["disks"], SIZE["two_disks"], max_step, [w0, 0.0, 0.0])
    return simulate(plant, duration, rtol, output_times)


def chain(n):
    """n inertias J [kg m2] on a line, top first, and the torques on them but for dry friction.

    J_i w_i' = k (psi_i-1 - psi_i) + c (..)' + top - c_r w_0 - c_b w_n-1,  psi_i' = w_i - w_i+1
    States: n - 1 twists psi [rad], then n speeds w [rad/s]; k = 473 (n - 1), c = 23.2 (n - 1).
    """
    J = np.r_[2122.0, np.full(n - 2, 800.0 / (n - 2)), 374.0]
    k, c, c_r, c_b = 473.0 * (n - 1), 23.2 * (n - 1), 425.0, 50.0

    def torques(y, top):
        w = y[n - 1 :]
        spring = k * y[: n - 1] + c * (w[:-1] - w[1:])
        T = np.zeros(n)
        T[1:] = spring
        T[:-1] -= spring
        T[0] += top - c_r * w[0]
        T[-1] -= c_b * w[-1]
        return T

    return J, torques


def chain_bit(duration=60.0, n=10, rtol=1e-10, output_times=None, max_step=0.25) -> Reference:
    """Chain with the bit law at its lower end and a constant top torque of 12 000 N m."""
    J, torques = chain(n)
    p, top = Rig(), 12000.0

    def rate(t, y, modes):
        w, T = y[n - 1 :], torques(y, top)
        T[-1] = T[-1] - p.bit_torque(w[-1], modes[0]) if modes[0] else 0.0
        return np.concatenate((w[:-1] - w[1:], T / J))

    def stop(y, i):
        y[-1] = 0.0

    static, start = [p.WR * p.mu_s], [0.0] * (2 * n - 1)
    plant = Plant(rate, lambda y: [y[-1]], lambda t, y: [-torques(y, top)[-1]], static, stop, ["bit"], chain_size(n), max_step, start)
    return simulate(plant, duration, rtol, output_times)


def chain_all(duration=60.0, n=10, rtol=1e-10, output_times=None, max_step=0.1) -> Reference:
    """Chain with Coulomb friction at every inertia: 3000 N m on top, 300 N m each, 6000 N m below.

    top = 8000 + 8000 sin(0.8 t) N m;  static = kinetic;  contacts "chain.0" (top) to "chain.n-1"
    """
    J, torques = chain(n)
    F = np.r_[3000.0, np.full(n - 2, 300.0), 6000.0]

    def top(t):
        return 8000.0 + 8000.0 * sin(0.8 * t)

    def rate(t, y, modes):
        w, s = y[n - 1 :], np.array(modes)
        T = np.where(s, torques(y, top(t)) - s * F, 0.0)
        return np.concatenate((w[:-1] - w[1:], T / J))

    def hold(t, y):
        return (-torques(y, top(t))).tolist()

    def stop(y, i):
        y[n - 1 + i] = 0.0

    contacts, start = [f"chain.{i}" for i in range(n)], [0.0] * (2 * n - 1)
    plant = Plant(rate, lambda y: y[n - 1 :].tolist(), hold, F.tolist(), stop, contacts, chain_size(n), max_step, start)
    return simulate(plant, duration, rtol, output_times)


def heyoka_run(state, rate, slip, hold, static, mode, stop, contact, tol):
    """One contact from rest on heyoka's Taylor integrator, compiled; returns `run`.

    run(duration, output_times=None) -> Reference, with the last state alone if no times are given.

    rate(s, moving) gives the right-hand sides, with s = +1, 0, -1 and moving = |s| as parameters.

    Why one event for both switches: the margin s v + (1 - |s|) (1 - (hold/F_s)^2) has one cooldown,
    which covers the start of slip. There margin and slope are zero, a double root; with one event
    each, the stick event finds it at once or loses what follows. The callback stays inside
    heyoka's loop and writes to views made once; leaving the loop was 10 per cent slower.
    """
    import heyoka

    s, moving = heyoka.par[0], heyoka.par[1]
    margin = s * slip + (1.0 - moving) * (1.0 - (hold(state) / static) ** 2)
    found = []

    def switch(integrator, slope):
        before = pars[0]
        stop(now)
        force = hold(now)
        after = 0.0 if before and abs(force) <= static else (-1.0 if force > 0 else 1.0)
        pars[0], pars[1] = after, abs(after)
        found.append((integrator.time, before, after))
        return True

    event = heyoka.t_event(margin, callback=switch, direction=heyoka.event_direction.negative)
    ode, rest = list(zip(state, rate(s, moving), strict=True)), [0.0] * len(state)
    taylor = heyoka.taylor_adaptive(ode, rest, pars=[0.0, 0.0], t_events=[event], tol=tol, compact_mode=False, fast_math=True)
    now, pars = taylor.state, taylor.pars

    def run(duration, output_times=None):
        found.clear()
        began = perf_counter()
        taylor.time = 0.0
        taylor.reset_cooldowns()
        now[:], pars[0], pars[1] = 0.0, mode, abs(mode)
        sampled = None if output_times is None else taylor.propagate_grid(output_times)[-1]
        taylor.propagate_until(duration)
        wall_time = perf_counter() - began
        times, states = ([duration], [now.copy()]) if sampled is None else (output_times, sampled)
        switches = tuple(Switch(t, contact, MODES[int(a)], MODES[int(b)]) for t, a, b in found)
        return Reference(np.array(times), np.array(states), switches, wall_time)

    return run


def heyoka_belt(tol):
    """`belt` on heyoka."""
    import heyoka

    m, k, F_s, delta, v_belt = 1.0, 1.0, 1.0, 3.0, 0.2
    x, v = heyoka.make_vars("x", "v")

    def rate(s, moving):
        F = -s * F_s / (1.0 + delta * s * (v - v_belt))
        return [v, moving * (F - k * x) / m]

    def stop(now):
        now[1] = v_belt

    return heyoka_run([x, v], rate, v - v_belt, lambda y: k * y[0], F_s, -1, stop, "belt", tol)


def heyoka_rig(tol):
    """`rig` on heyoka."""
    import heyoka

    p = Rig()
    twist, w_r, w_b, z = heyoka.make_vars("twist", "w_r", "w_b", "z")
    string = p.k * twist + p.c_12 * (w_r - w_b)
    u = p.Kp * (p.Om - w_r) + p.Ki * z

    def rate(s, moving):
        T = s * p.WR * (p.mu_c + (p.mu_s - p.mu_c) * heyoka.exp(-p.gamma * s * w_b))
        return [w_r - w_b, (u - p.c_r * w_r - string) / p.J_r, moving * (string - p.c_b * w_b - T) / p.J_b, p.Om - w_r]

    def hold(y):
        return -(p.k * y[0] + p.c_12 * y[1])  # at w_b = 0

    def stop(now):
        now[2] = 0.0

    return heyoka_run([twist, w_r, w_b, z], rate, w_b, hold, p.WR * p.mu_s, 0, stop, "bit", tol)
