"""Are the steps that `simulate` chooses as right as explicit formulas on every shipped scene, and how much faster?

Every case of every scene is run by the steps that are chosen (default, below) and by explicit formulas, both at the accuracy of the scene. Cases where
the default is explicit, too, are only named. Columns: states; switches by each; the largest difference of the time of a switch, in parts of the run; the
error of each run against one at a hundredth of the accuracy; time of the loop by explicit formulas, and what part of it the default takes (the least of
turns that alternate). A case is sensitive where a run by explicit formulas has an error above SENSITIVE: its switches are then no property of the machine.

    python -m studies methods [--only SCENE ...] [--turns 11]
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from studies.command_line import parser_of
from studies.timing import least
from toolbox import Trajectory, simulate
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.scenes.contact_scene import ContactScene, load_scene

SCENES = Path(__file__).parents[1] / "scenes"
SENSITIVE = 1e-2
"""Error of a run, relative to the size of its motion, from which the motion forgets its start."""


@dataclass(frozen=True)
class Pair:
    """A case by explicit formulas and by the default method."""

    title: str
    loop: ClosedLoop
    explicit: Trajectory
    default: Trajectory

    @property
    def sensitive(self) -> bool:
        """Whether the motion forgets its start."""
        return self.explicit.error_estimate > SENSITIVE

    @property
    def same_switches(self) -> bool:
        """Whether both runs switch the same elements in the same way and order."""
        one, other = ([(event.element, event.before, event.after) for event in run.events] for run in (self.explicit, self.default))
        return one == other

    @property
    def shift(self) -> float:
        """Largest difference of the time of a switch, in parts of the run; NaN where they are not the same."""
        if not self.same_switches:
            return np.nan
        times = [np.array([event.time for event in run.events]) for run in (self.explicit, self.default)]
        return float(np.abs(times[0] - times[1]).max(initial=0.0)) / self.default.duration

    def ratio(self, turns: int) -> tuple[float, float]:
        """Time of the loop by explicit formulas [s], and what part of it the default takes."""
        explicit, default = least(
            [lambda: simulate(self.loop, method="explicit").wall_time, lambda: simulate(self.loop).wall_time],
            turns if self.explicit.wall_time < 0.1 else 1,
        )
        return explicit, default / explicit


def names() -> list[str]:
    """The shipped scenes."""
    return sorted(path.stem for path in SCENES.glob("*.toml"))


def pairs(name: str) -> Iterator[Pair | str]:
    """The cases of a scene in which the default is not explicit; of others their title and the reason."""
    scene = load_scene(SCENES / f"{name}.toml")
    if isinstance(scene, ContactScene):
        yield f"{name}: stepped"
        return
    for label in scene.labels:
        loop, title = scene[label], f"{name}, {label}"
        if loop.system.updates:  # the rule's own reason, without a run that may take a minute
            yield f"{title}: a law is sampled"
            continue
        default = simulate(loop)
        if not default.program.formulas.series:
            yield f"{title}: {default.why}"
            continue
        yield Pair(title, loop, simulate(loop, method="explicit"), default)


def line(pair: Pair, turns: int) -> str:
    """A line of the table."""
    explicit, ratio = pair.ratio(turns)
    counts = f"{len(pair.explicit.events):7d}{len(pair.default.events):7d}"
    said = "sensitive" if pair.sensitive else "" if pair.same_switches else "OTHER SWITCHES"
    errors = f"{pair.explicit.error_estimate:10.1e}{pair.default.error_estimate:10.1e}"
    return f"{pair.title[:48]:<48}{pair.default.states.shape[1]:4d}{counts}{pair.shift:10.1e}{errors}{1e3 * explicit:10.3f}{ratio:7.2f}  {said}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = parser_of(__doc__)
    parser.add_argument("--only", nargs="+", choices=names(), default=names(), metavar="SCENE", help="scenes (all)")
    parser.add_argument("--turns", type=int, default=11, help="turns that alternate, of which the least counts (11)")
    given = parser.parse_args(arguments)
    print(f"{'':<48}{'n':>4}{'switches':>14}{'shift':>10}{'error':>20}{'[ms]':>10}{'ratio':>7}")
    print(f"{'':<52}{'expl.':>7}{'deflt.':>7}{'':>10}{'expl.':>10}{'deflt.':>10}")
    others = list[str]()
    for name in given.only:
        for found in pairs(name):
            if isinstance(found, str):
                others.append(found)
            else:
                print(line(found, given.turns), flush=True)
    print("\nExplicit by default, too:", *others, sep="\n  ")


if __name__ == "__main__":
    main()
