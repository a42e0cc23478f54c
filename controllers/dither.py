"""Dither of a normal load: sine, square, swept, and phased with the slip; and the map that shows where it helps.

    N(t) = N_0 (1 + depth wave(t))

Fast normal dither does not linearise dry friction as tangential dither does: friction is proportional to N, so that its mean stays what it was. It
works by entrainment, in a band of frequencies above the natural one, some 2 to 5 times it for Leine's block; below the band it amplifies the
stick-slip, far above it does nothing. Where the band is must be measured on the plant: `dither_map`.

`PhasedDither` needs no band: it presses harder while the contact slips faster than its mean and lighter while it slips slower,

    N = N_0 (1 + depth clip((v - v_0) / size, -1, 1)),   d(mu N)/dv at v_0 = N_0 (mu' + mu depth / size)

and friction rises with speed where depth / size > -mu' / mu. It must know the slip in time: what comes late by tau keeps cos(w tau) of it, nothing
after a quarter of the period, and feeds the swing later. All of this moves a load as fast as the plant swings: what does that is not modelled.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from toolbox import Controller, Equations, HybridSystem, Quantity, SceneError, Update, measure, quantity, simulate, time
from toolbox.authoring import columns, new_names_only, number, stands
from toolbox.inputs import sine
from toolbox.modelling import OptionalQuantity


def declared_load(plant: HybridSystem, load: str) -> float:
    """Return the default [N] of an input of a plant. SceneError is raised if the plant has no such input."""
    if load not in plant.inputs:
        raise SceneError(f"Argument `load` must be an input of the plant, but `{load}` is none of {', '.join(plant.inputs)}.")
    return float(np.array(plant.input_defaults(plant.values)).ravel()[list(plant.inputs).index(load)])


@dataclass(frozen=True, kw_only=True)
class LoadDither(Controller):
    """Base class of the dithers of a normal load: they give `load` the value mean (1 + depth wave), with |wave| <= 1.

    With `over` they give `load`, such as `brake.disturbance`, the value depth wave times the signal `over`, the force
    that another controller commands. `mean` is by default the default of the input `load`.
    """

    load: str = "bit.weight"
    over: str | None = None
    mean: OptionalQuantity = quantity(None, "N", "mean load N_0", above=0)
    depth: Quantity = quantity(0.5, "1", "amplitude as a fraction of the mean", at_least=0, at_most=1)

    @property
    def actuated_signals(self) -> tuple[str, ...]:  # type: ignore[override]
        """The load."""
        return (self.load,)

    def design(self, plant: HybridSystem) -> Any:
        """The law with the mean load read from the plant."""
        if self.mean is not None or self.over is not None:
            return self
        return replace(self, mean=declared_load(plant, self.load))

    def loaded(self, signal: Any, wave: Any) -> dict[str, tuple[Any, str]]:
        """The load under a wave between -1 and 1."""
        if self.over is not None:
            return {self.load: (self.depth * signal(self.over, "N") * wave, "N")}
        return {self.load: (self.mean * (1.0 + self.depth * wave), "N")}


@dataclass(frozen=True, kw_only=True)
class NormalDither(LoadDither):
    """Sinusoidal dither of a normal load with one frequency: load = mean (1 + depth sin(2 pi frequency t)).

    - `load` is the name of the input that the controller gives (default `bit.weight`).
    - `mean` is the mean of the load, by default the value of this input in the plant. `depth` (default 0.5) and
      `frequency` [Hz] (default 1) describe the wave.
    - `over` is the name of a force that another controller commands, such as `brake.force`. The input `load`, such as
      `brake.disturbance`, is then depth sin(2 pi frequency t) times this force.

    The controller runs continuously or sampled.

    Examples
    --------
    >>> from controllers import NormalDither
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> print(closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), NormalDither()))
    Closed loop: TorsionalChain, BitRock
      NormalDither, continuous: mean 97 kN, depth 0.5, frequency 1 Hz
      the parameter bit.weight has no effect: a controller gives the signal bit.weight (vary a number of the controller)
    """

    frequency: Quantity = quantity(1.0, "Hz", "frequency of the dither", above=0)

    def wave(self) -> Any:
        """Return the wave sin(2 pi frequency t) as a casadi expression of the symbol `toolbox.time`, with values from -1 to 1.

        The method takes no argument: an expression is not a number, and a run replaces the symbol by its time.
        """
        return ca.sin(2.0 * ca.pi * self.frequency * time)

    def continuous(self, signal):
        return Equations(outputs=self.loaded(signal, self.wave()))

    def sampled(self, signal, period):
        return Update(memory={}, outputs=self.loaded(signal, self.wave()))


@dataclass(frozen=True, kw_only=True)
class SquareDither(NormalDither):
    """Square-wave dither of a normal load: the load jumps between two values, once in every half period.

        load(t) = mean (1 + depth s(t)),   s(t) = 1 if sin(2 pi frequency t) >= 0, else -1

    - `load` is the name of the input that the controller gives (default `bit.weight`).
    - `mean` is the mean of the load [N], by default the value of this input in the plant. `depth` is a fraction of the
      mean [1] (default 0.5), and `frequency` the frequency [Hz] (default 1).
    - `over` is the name of a force that another controller commands, such as `brake.force` (default None). With `over`
      the controller gives the input `load`, such as `brake.disturbance`, the value depth s(t) times this force. `mean`
      is then ignored.

    The controller runs sampled only, so that the jumps are at samples. `toolbox.inputs.square` is the same wave as an
    input.

    Examples
    --------
    >>> from controllers import SquareDither
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, closed_loop, compose
    >>> print(closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), Sampled(SquareDither(), "10 ms")))
    Closed loop: TorsionalChain, BitRock
      SquareDither, sampled every 10 ms: mean 97 kN, depth 0.5, frequency 1 Hz
      the parameter bit.weight has no effect: a controller gives the signal bit.weight (vary a number of the controller)
    """

    def continuous(self, signal):
        raise SceneError("SquareDither jumps: give `sample_time`, or use the input `square`.")

    def wave(self):
        return ca.if_else(super().wave() >= 0.0, 1.0, -1.0)


@dataclass(frozen=True, kw_only=True)
class SweptDither(NormalDither):
    """Sinusoidal dither of a normal load with the varying frequency f(t) = frequency + frequency_deviation sin(2 pi t / sweep_time).

    The load is mean (1 + depth sin(phase)), and the phase grows at the rate 2 pi f(t). `load` is the name of the input
    that the controller gives (default `bit.weight`), `mean` the mean of the load (default: the value of this input in
    the plant), and `depth` a fraction of the mean (default 0.5). The frequency varies by `frequency_deviation` above
    and below `frequency` [Hz], with the period `sweep_time` [s].

    By default the dither acts on the weight on bit: the controller gives the input `bit.weight`. The parameter `weight`
    of the rock is then only the mean of the dither.

    Examples
    --------
    >>> from controllers import SweptDither
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> print(closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), SweptDither()))
    Closed loop: TorsionalChain, BitRock
      SweptDither, continuous: mean 97 kN, depth 0.5, frequency 1 Hz, frequency_deviation 0.4 Hz, sweep_time 20 s
      the parameter bit.weight has no effect: a controller gives the signal bit.weight (vary a number of the controller)
    """

    frequency_deviation: Quantity = quantity(0.4, "Hz", "largest deviation from `frequency` in both directions", at_least=0)
    sweep_time: Quantity = quantity(20.0, "s", "period of the sweep", above=0)

    def check(self):
        number("frequency_deviation", self.frequency_deviation, "Hz", below=self.frequency)

    def wave(self):
        swing = self.frequency_deviation * self.sweep_time * (1.0 - ca.cos(2.0 * ca.pi * time / self.sweep_time))
        return ca.sin(2.0 * ca.pi * self.frequency * time + swing)


@dataclass(frozen=True, kw_only=True)
class PhasedDither(LoadDither):
    """Dither of a normal load in phase with the slip speed: load = mean (1 + depth clip((v - reference) / speed_scale, -1, 1)).

    v is the signal `speed`, and `reference` is its value at the mean slip. The load is higher than `mean` while the
    contact slips faster than on average, so friction rises with speed.

    - `speed_scale` is the deviation of v at which the full depth is reached. It is negative if the slip speed falls
      while v rises. Example: a block on a moving belt, whose slip speed falls while the block moves with the belt.
    - `unit` is by default the unit of the signal `speed` in the plant.

    `load` is the name of the input that the controller gives (default `bit.weight`), and `mean` the mean of the load
    (default: the value of this input in the plant). With the name of a force in `over`, the load is the deviation from
    the mean only, multiplied by this force in place of `mean`. The controller runs continuously or sampled.

    Examples
    --------
    >>> from controllers import PhasedDither
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> print(closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), PhasedDither(reference="60 rpm")))
    Closed loop: TorsionalChain, BitRock
      PhasedDither, continuous: mean 97 kN, depth 0.5, reference 60 rpm, speed_scale 9.549 rpm
      the parameter bit.weight has no effect: a controller gives the signal bit.weight (vary a number of the controller)
    """

    speed: str = "bit.speed"
    unit: str | None = None
    reference: Quantity = quantity(0.0, "rad/s", "value of the signal at the mean slip, in its unit")
    speed_scale: Quantity = quantity(1.0, "rad/s", "deviation of the signal at which the depth is reached, in its unit")

    @property
    def measured_signals(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the measured signals: the speed and, with `over`, the force to which the dither is added."""
        return (self.speed,) if self.over is None else (self.speed, self.over)

    def check(self):
        if self.speed_scale == 0:
            raise SceneError("Argument `speed_scale` must not be 0.")

    def design(self, plant: HybridSystem) -> Any:
        """Return the controller with the mean load and the unit of the speed from the plant, if they are not given.

        Parameters
        ----------
        plant
            The plant on which the controller is designed.
        """
        law = super().design(plant)
        return law if self.unit is not None else replace(law, unit=plant.unit(self.speed))

    def _wave(self, signal: Any) -> Any:
        return ca.fmin(ca.fmax((signal(self.speed, self.unit) - self.reference) / self.speed_scale, -1.0), 1.0)

    def continuous(self, signal):
        return Equations(outputs=self.loaded(signal, self._wave(signal)))

    def sampled(self, signal, period):
        return Update(memory={}, outputs=self.loaded(signal, self._wave(signal)))


def widest(frequencies: Sequence[float] | np.ndarray, fine: Sequence[bool] | np.ndarray) -> tuple[float, float]:
    """(lowest, highest) of the widest run of frequencies, in log, at which all is fine; nan for none."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(fine, int), [0]])))
    runs = [(float(frequencies[first]), float(frequencies[last - 1])) for first, last in zip(edges[::2], edges[1::2], strict=True)]
    return max(runs, key=lambda run: run[1] / run[0]) if runs else (np.nan, np.nan)


@dataclass(frozen=True)
class DitherMap:
    """Swing of a signal under a dithered load, as a fraction of its swing without dither: the result of `dither_map`.

    Attributes
    ----------
    natural
        Natural frequency [Hz].
    frequency, depth
        Frequencies [Hz] and depths of the dither.
    swing
        swing[i, j] at depth[i] and frequency[j], as a fraction of the swing without dither.
    stuck
        Fraction of the time that the contact sticks, in the same order. Where it is 1 the contact stands at the end, and a calm signal is no success.
    """

    natural: float
    frequency: np.ndarray
    depth: np.ndarray
    swing: np.ndarray
    stuck: np.ndarray

    @property
    def stands(self) -> np.ndarray:
        """True if the contact stands at the end, in the order of `swing`. Dither has then stopped a contact that should move."""
        return stands(self.stuck)

    def calm(self, below: float = 0.5) -> np.ndarray:
        """Where the contact slips and the swing stays below that fraction of the swing without dither, in the order of `swing`."""
        return (self.swing < below) & ~self.stands

    def band(self, depth: float, below: float = 0.5) -> tuple[float, float]:
        """(lowest, highest) frequency [Hz] of the widest run of frequencies, in log, that are `calm` at the nearest depth; nan if there is none."""
        return widest(self.frequency, self.calm(below)[int(np.argmin(np.abs(self.depth - depth)))])

    def choice(self, below: float = 0.5) -> tuple[float, float]:
        """(frequency [Hz], depth): the smallest depth with a band at least an octave wide, and the frequency in the middle of that band.

        If no band is so wide, the middle of the widest there is. Raises SceneError if nothing on the map calms the plant while its contact slips.
        """
        bands = [(depth, self.band(depth, below)) for depth in self.depth]
        found = [(depth, low, high) for depth, (low, high) in bands if low == low]
        if not found:
            standing = f" The contact stands at {int(self.stands.sum())} of {self.swing.size} points: hold its speed, as `HeldSpeed` does on a brake."
            raise SceneError(
                f"No dither on the map brings the swing below {below:g} of the swing without dither while the contact slips."
                + standing * bool(self.stands.any())
            )
        wide = [entry for entry in found if entry[2] >= 2.0 * entry[1]]
        depth, low, high = min(wide, key=lambda entry: entry[0]) if wide else max(found, key=lambda entry: entry[2] / entry[1])
        return float(np.sqrt(low * high)), float(depth)

    def __str__(self) -> str:
        head = f"Swing under dither as a fraction of the swing without dither; natural frequency {self.natural:.4g} Hz; * stands"
        rows = [["frequency [Hz]", *(f"depth {depth:.2g}" for depth in self.depth)]]
        for j, frequency in enumerate(self.frequency):
            stars = ("*" if stands else " " for stands in self.stands[:, j])
            rows.append([f"{frequency:.4g}", *(f"{swing:.2f}{star}" for swing, star in zip(self.swing[:, j], stars, strict=True))])
        table = columns(rows, (0,), "")
        lines = [head, table[0], "-" * len(table[0]), *table[1:]]
        try:
            frequency, depth = self.choice()
            lines.append(f"Choice: {frequency:.4g} Hz at depth {depth:.2g}")
        except SceneError as error:
            lines.append(str(error))
        return "\n".join(lines)


@new_names_only
def dither_map(
    plant: HybridSystem,
    load: str,
    mean: float,
    natural: float,
    *,
    contact: str,
    signal: str,
    ratios: Sequence[float] | np.ndarray,
    depths: Sequence[float] | np.ndarray,
    periods: float = 80.0,
    other_load: float = 0.0,
    **arguments: Any,
) -> DitherMap:
    """Map the amplitude of a signal over frequency and depth of an alternating load, by simulation.

    The load is mean (1 + depth sin(2 pi frequency t)) - other_load. Each run lasts `periods` natural periods, and its
    second half is evaluated.

    The map is valid for a machine whose mean speed is held constant. If the dither could stop the machine, such as a
    brake under a drive torque, hold its speed with `controller=HeldSpeed(reference=...)`. Points at which the contact
    stands still are never recommended.

    Parameters
    ----------
    plant
        The plant.
    load
        Name of the input that alternates. To include the dynamics of an actuator, make the actuator part of the plant
        and give its command as load.
    mean
        Mean of the load, in SI, > 0.
    natural
        Natural frequency of the machine [Hz]. `ratios` are multiples of this frequency.
    contact, signal
        Names of the contact that is evaluated and of the signal whose amplitude is mapped.
    ratios
        Frequencies of the alternation as multiples of `natural`, shape (n_ratios,).
    depths
        Amplitudes of the alternation as fractions of `mean`, shape (n_depths,).
    periods
        Length of a run in natural periods, by default 80.
    other_load
        Part of the load that another input gives [N], by default 0. For the input `brake.disturbance`, for example, it
        is the constant `brake.force`.
    arguments
        Further arguments of `simulate`, such as `controller` and `start`.

    Returns
    -------
    DitherMap
        The amplitude at every frequency and depth. It prints as a table.

    Raises
    ------
    SceneError
        If `mean` or `natural` is not positive, or if the signal does not vibrate without dither.

    Examples
    --------
    >>> from controllers import dither_map
    >>> from models import oscillators
    >>> from toolbox import compose
    >>> block = compose(oscillators.LEINE)
    >>> print(dither_map(block, "block.load", 1.0, 0.159, contact="belt", signal="block.position", ratios=(0.5, 3.5), depths=(0.8,)))
    Swing under dither as a fraction of the swing without dither; natural frequency 0.159 Hz; * stands
    frequency [Hz]  depth 0.8
    -------------------------
    0.0795              1.88
    0.5565              0.38
    Choice: 0.5565 Hz at depth 0.8
    """
    mean, natural = number("mean", mean, "N", above=0), number("natural", natural, "Hz", above=0)
    duration = periods / natural
    given: Mapping[str, Any] = arguments.pop("inputs", None) or {}

    def found(depth: float, ratio: float) -> tuple[float, float]:
        wave = {load: sine(mean - other_load, depth * mean, ratio * natural)} if depth else {load: mean - other_load}
        run = simulate(plant, duration, inputs={**given, **wave}, **arguments)
        extent = measure.extent(run, signal, duration / 2)
        stuck = measure.stuck_ratio(run, contact, duration / 2)
        standing = stands(measure.stuck_ratio(run, contact, 7 * duration / 8))
        return extent.maximum - extent.minimum, 1.0 if standing else stuck

    alone, stuck = found(0.0, 1.0)
    if stands(stuck) or not alone > 0:
        calm = (
            f"The contact `{contact}` stands without dither"
            if stands(stuck)
            else f"The plant is calm without dither: `{signal}` does not swing"
        )
        raise SceneError(
            f"{calm}. A brake needs its speed held (`controller=HeldSpeed(reference=...)`); what rests and could swing must begin in motion by `start={{...}}`."
        )
    table = np.array([[found(depth, ratio) for ratio in ratios] for depth in depths])
    return DitherMap(natural, natural * np.asarray(ratios, float), np.asarray(depths, float), table[:, :, 0] / alone, table[:, :, 1])
