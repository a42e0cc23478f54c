"""Groups of machines that a law of a drill string has to do well on, beside the declared one: other numbers, later commands, a weight that varies."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from toolbox.errors import SceneError
from toolbox.modelling import inputs as shapes
from toolbox.modelling.closed_loop import ClosedLoop, as_loop, closed_loop
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.probability.distributions import Draws, drawn
from toolbox.vocabulary import Renamed, new_names_only

NAMES = ("nominal", "noisy", "one_at_a_time", "combined", "other_rocks", "varying_weight")
"""Names of the groups of a drill string."""
LASTING, FEW, SEEN = 1800.0, 2, 3
"""Judged window [s] of the runs that confirm a set-point, and the most phases and seeds of them."""


SEEDS = tuple(range(101, 121))
"""Seeds of the noise."""
COURSES = 10
"""Seeds of a weight that varies."""
GOLDEN = 0.6180339887498949
"""Part of a turn from the phase of one seed to that of the next: the phases of any number of seeds lie apart."""


@dataclass(frozen=True)
class Varying:
    """Variation of the weight on bit about its mean in time: a sine, or noise.

    Attributes
    ----------
    size
        Amplitude of the sine, or standard deviation of the noise, as a fraction of the mean.
    frequency
        Frequency of the sine, or corner frequency of the noise [Hz].
    noise
        Whether the variation is noise (True) or a sine (False, default).

    Examples
    --------
    >>> from toolbox.drilling import Varying
    >>> weight = Varying(size=0.1, frequency=0.1).input(97e3, seed=1)
    >>> print([round(end / 1e3, 1) for end in weight.range()], "kN")
    [87.3, 106.7] kN
    """

    size: float
    frequency: float
    noise: bool = False

    def input(self, mean: float, seed: int) -> Any:
        """Return the weight as an input, with the mean `mean` [N]. The seed is the seed of the noise, or chooses the phase of the sine.

        Parameters
        ----------
        mean
            Mean weight on bit [N].
        seed
            Whole number, by which noise and phase are chosen.
        """
        varied = (mean, self.size * mean, self.frequency)
        return (
            shapes.noise(*varied, seed=seed)
            if self.noise
            else shapes.sine(*varied, phase=2.0 * math.pi * (GOLDEN * (seed - SEEDS[0]) % 1.0))
        )


@dataclass(frozen=True)
class Machine(Renamed):
    """Description of a plant that deviates from the declared plant, for a `Group`.

    Attributes
    ----------
    name
        Name of the deviation.
    parameter_factors
        Pairs (number of the loop, factor of its declared value).
    delay
        Additional delay of the commands [s].
    plant
        Plant with the same signal names that replaces the declared plant. None for the declared plant.
    weight_variation
        Variation of the weight on bit in time. None for a constant weight.

    Examples
    --------
    >>> from toolbox.drilling import Machine
    >>> machine = Machine("weight +10 %", (("bit.weight", 1.1),), delay=0.03)
    >>> print(machine.parameter_factors, machine.delay, "s")
    (('bit.weight', 1.1),) 0.03 s
    """

    name: str
    parameter_factors: tuple[tuple[str, float], ...] = ()
    delay: float = 0.0
    plant: HybridSystem | None = field(default=None, repr=False)
    weight_variation: Varying | None = None


@dataclass(frozen=True)
class Group(Renamed):
    """Group of plants on which a controller is judged, with the seeds of the noise and the takeover phases.

    Attributes
    ----------
    name
        Name of the group.
    machines
        The plants.
    seeds
        Seeds of the noise.
    noise
        Standard deviation of the measured top speed [rad/s]. 0 for no noise.
    takeover_phases
        Phases of the stick-slip cycle at which the controller takes over, as fractions of its period.
    judged_time
        Time after the takeover after which a run is judged [s], by default 80.
    min_disk_margin
        Smallest allowed disk margin at the border, on the nominal plant and on every plant of the group, if the
        controller has a slope. A border that is confirmed by a long run is raised until it has this margin.

    Examples
    --------
    >>> from toolbox.drilling import Group, Machine
    >>> heavy = Group("heavy", (Machine("weight +10 %", (("bit.weight", 1.1),)),), seeds=(0, 1), takeover_phases=(0.0, 0.5))
    >>> print(heavy.runs, "runs at one set-point")
    4 runs at one set-point
    """

    name: str
    machines: tuple[Machine, ...]
    seeds: tuple[int, ...] = (0,)
    noise: float = 0.01
    takeover_phases: tuple[float, ...] = tuple(k / 8 for k in range(8))
    judged_time: float = 80.0
    min_disk_margin: float = field(default=0.0, repr=False)

    @property
    def runs(self) -> int:
        """Number of runs at one set-point: plants times seeds times takeover phases."""
        return len(self.machines) * len(self.seeds) * len(self.takeover_phases)

    @property
    def lasting(self) -> Group:
        """The same plants with fewer phases and seeds, for runs of half an hour."""
        chosen = self.takeover_phases[:: max(1, len(self.takeover_phases) // FEW)][:FEW]
        return replace(self, seeds=self.seeds[:SEEN], takeover_phases=chosen, judged_time=LASTING)


WEIGHTS = (
    Varying(0.02, 0.2, noise=True),
    Varying(0.05, 0.2, noise=True),
    Varying(0.05, 0.17),
    Varying(0.1, 0.1),
)
"""Weights that vary: 2 and 5 % rms with a corner at 0.2 Hz, 5 % at the frequency of a string of 2 km, a heave of 10 % every ten seconds."""


@new_names_only
def machine_groups(machine: ClosedLoop | HybridSystem, noise: float = 0.01, delay: float = 0.03) -> dict[str, Group]:
    """Return the standard groups of plants for `lowest_set_point`, for a drill string with a chain of inertias and a rock.

        nominal          as declared, no noise
        noisy            weight + 10 %, noise, 20 seeds
        one_at_a_time    one deviation: inertia of the drive +-10 and +-20 %, inertia below it, stiffness and weight +-20 %, commands later; 3 seeds
        combined         (drive, below, stiffness) = (.8, 1.2, .8), (1.2, .8, 1.2), (.8, .8, .8); 3 seeds
        other_rocks      half the decay of the friction with speed; 3 seeds; only for a rock with an exponential law
        varying_weight   a weight that varies in time: `WEIGHTS`, 10 seeds, 2 phases, judged for 600 s

    Parameters
    ----------
    machine
        The drill string, or a loop around it.
    noise
        Standard deviation of the noise of the measured top speed [rad/s], by default 0.01.
    delay
        Additional delay of the commands [s] on one plant of `one_at_a_time`, by default 0.03.

    Returns
    -------
    dict of {name: Group}
        The groups.

    Raises
    ------
    SceneError
        If the machine is no drill string with a chain of inertias and a rock.

    Examples
    --------
    >>> from models import BitRock, wells
    >>> from toolbox import compose
    >>> from toolbox.drilling import machine_groups
    >>> for name, group in machine_groups(compose(wells.JANSEN_2, BitRock(weight="97 kN"))).items():
    ...     print(f"{name:15} {len(group.machines)} plants")
    nominal         1 plants
    noisy           1 plants
    one_at_a_time   11 plants
    combined        3 plants
    other_rocks     1 plants
    varying_weight  4 plants
    """
    names = list((machine if isinstance(machine, ClosedLoop) else closed_loop(machine)).without_controllers.variable_numbers())

    def entries(name: str) -> list[str]:
        return [each for each in names if each.rpartition(".")[0] == name]

    places = {"drive": entries("chain.inertia")[:1], "bit": entries("chain.inertia")[1:], "stiffness": entries("chain.stiffness")}
    places["weight"] = ["bit.weight"] if "bit.weight" in names else []
    for word, found in places.items():
        if not found:
            raise SceneError(
                f"The machines beside a declared one are those of a drill string with a chain of inertias and a rock, but its {word} is not known."
            )

    def other(name: str, delay: float = 0.0, **factors: float) -> Machine:
        return Machine(name, tuple((place, factor) for word, factor in factors.items() for place in places[word]), delay)

    singles = [other(f"drive {100 * (each - 1):+.0f} %", drive=each) for each in (0.8, 0.9, 1.1, 1.2)]
    singles += [
        other(f"{word} {100 * (each - 1):+.0f} %", **{word: each}) for word in ("bit", "stiffness", "weight") for each in (0.8, 1.2)
    ]
    corners = [
        other(f"drive {a:g}, bit {b:g}, stiffness {c:g}", drive=a, bit=b, stiffness=c)
        for a, b, c in ((0.8, 1.2, 0.8), (1.2, 0.8, 1.2), (0.8, 0.8, 0.8))
    ]
    groups = [
        Group("nominal", (Machine("nominal"),), noise=0.0),
        Group("noisy", (other("weight +10 %", weight=1.1),), SEEDS, noise),
        Group("one_at_a_time", (*singles, other(f"commands {1e3 * delay:.0f} ms later", delay)), SEEDS[:3], noise),
        Group("combined", tuple(corners), SEEDS[:3], noise),
    ]
    if "bit.friction.decay" in names:
        groups.append(Group("other_rocks", (Machine("half the decay", (("bit.friction.decay", 0.5),)),), SEEDS[:3], noise))
    varying = tuple(
        Machine(f"weight {'noise' if each.noise else 'sine'} {100 * each.size:g} %, {each.frequency:g} Hz", weight_variation=each)
        for each in WEIGHTS
    )
    groups.append(Group("varying_weight", varying, SEEDS[:COURSES], noise, (0.0, 0.5), 600.0))
    return {group.name: group for group in groups}


@new_names_only
def drawn_group(
    loop: ClosedLoop | Any, uncertainty: Mapping[str, Any] | Draws, draws: int = 72, *, phases: Sequence[float] = (0.0, 0.5), seed: int = 0
) -> Group:
    """Draw plants with uncertain numbers, as a group for `lowest_set_point`.

    If a set-point ends the stick-slip of all drawn plants, it also ends the stick-slip of any other plant with these
    uncertain numbers with some probability. With 72 draws this probability is at least 95 %, by the two-sided bound of
    Clopper and Pearson at the confidence level 95 %. With the one-sided bound 59 draws are enough.

    Parameters
    ----------
    loop
        A loop, or a plant, with the declared numbers. No number that is drawn may be zero.
    uncertainty
        {name: distribution} of independent numbers, each `Normal`, `Uniform`, `LogNormal`, or text such as "97 kN +-
        8 kN" with the standard deviation of a normal distribution. Or `Draws` of numbers that are known together.
    draws
        Number of plants, by default 72.
    phases
        Phases of the cycle at which a controller takes over on each plant, as fractions of its period, by default 0 and
        0.5.
    seed
        Seed of the random numbers, by default 0.

    Returns
    -------
    Group
        The plants, under the name `drawn`.

    Raises
    ------
    SceneError
        If a name is unknown or a sample time, a value is no distribution, more than half of a distribution is out of
        the bounds of its number, or a declared number is zero.

    Examples
    --------
    >>> from models import BitRock, wells
    >>> from toolbox import compose
    >>> from toolbox.drilling import drawn_group
    >>> group = drawn_group(compose(wells.JANSEN_2, BitRock()), {"bit.weight": "97 kN +- 8 kN"})
    >>> print(group.name, len(group.machines))
    drawn 72
    """
    loop = as_loop(loop)
    made = drawn(loop, uncertainty, draws, seed)
    declared = [loop.number(name).value for name in made.names]
    if 0.0 in declared:
        raise SceneError(f"Argument `uncertainty` must name numbers that are not zero, but `{made.names[declared.index(0.0)]}` is.")
    machines = []
    for k, row in enumerate(made.points.tolist()):
        machines.append(Machine(f"draw {k + 1}", tuple((name, v / at) for name, v, at in zip(made.names, row, declared, strict=True))))
    return Group("drawn", tuple(machines), takeover_phases=tuple(phases))
