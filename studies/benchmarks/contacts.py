"""What do more contacts, kept modes and shorter steps of an elastic face buy, and what do they cost?

    python -m studies contacts            (needs the extra `fe`; some five minutes)

The cube of `studies elastic_sliders` on 11 rows with given loads, and on 121 and 300 nodes with cone and opening, under two drives. Slow: the plate speeds up
over 0.24 s, and statics are all that counts. Struck: a force of 10 N pushes the back for 20 us, so that waves run through the cube, the face slips
and sticks again within 80 us. Errors are those of the friction on the face, in parts of its largest, and of the share of the face that sticks, in the mean
over time; both against the run with all modes and the shortest step of as many contacts, and for the modes left out against all modes and the same step.
Times are those of the processor with one thread, the shorter of two runs, from the reduced body to the end. The tables are Markdown.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from time import process_time
from typing import Any

import numpy as np

from models import ElasticSlider, Exponential, ReducedBody
from studies.questions.elastic_sliders import ACCELERATION, DAMPING, PRESSURE, SIDE, STIFFNESS, Pull, cube, first_slips, measures, row_run
from studies.timing import timed
from toolbox import Trajectory, compose, simulate
from toolbox.contacts import ContactProblem, ContactRun, press_contacts, step_contacts
from toolbox.inputs import ramp

FRICTION = Exponential(static=0.35, kinetic=0.25, decay=1.0)
HEAD = "| contacts | modes | step | error of force | by modes left out | error of share | passes a step | time |\n|---|---|---|---|---|---|---|---|"


@dataclass(frozen=True)
class Face:
    """The cube with all its modes: the body, its contacts and loads, and what places and areas they have."""

    name: str
    body: ReducedBody
    options: dict[str, Any]
    load: dict[str, float]

    def problem(self, modes: int, mount: tuple[float, float] = (0.0, 0.0)) -> ContactProblem:
        """The problem with the lowest modes, and with a spring and a damper at the back."""
        kept = len(self.body.ports) + modes
        matrices = {word: getattr(self.body, word)[:kept, :kept] for word in ("mass", "damping", "stiffness")}
        return replace(self.body, **matrices).mounted({"back": mount}).in_contact(FRICTION, **self.options)


def rows(band: float) -> Face:
    """Eleven rows that slide along the pull under loads from statics."""
    body = cube((10, 4, 4), damping_time=1e-6).clamped("bottom", "yz")
    ports = {f"x.{i}": row for i, row in enumerate(body.node_row_ports("bottom", "x", "x"))} | {"back": body.mean("left", "x")}
    areas = body.node_row_areas("bottom", "x")
    return Face(
        "11 rows",
        body.reduced(ports, band).controllable_body,
        {"tangent": ("x",), "load": PRESSURE * areas, "force_ports": ("back",), "contact_areas": areas},
        {},
    )


def nodes(divisions: tuple[int, int, int], band: float) -> Face:
    """Every node of the face, with its own pressure and two directions of slip."""
    body = cube(divisions, damping_time=1e-6)
    face = body.face_nodes("bottom")
    ports = {f"{axis}.{i}": body.point(node, axis) for axis in "xyz" for i, node in enumerate(face)}
    ports |= {"back": body.mean("left", "x"), "top": body.mean("top", "z")}
    options = {
        "tangent": ("x", "y"),
        "normal": "z",
        "force_ports": ("back", "top"),
        "contact_positions": body.nodes[face],
        "contact_areas": body.faces["bottom"][face],
    }
    return Face(f"{len(face)} nodes", body.reduced(ports, band), options, {"top": -PRESSURE * SIDE**2})


# --------------------------------------------------------------------------------------------------------------------------------------------- drives
def slow(face: Face, modes: int, step: float) -> ContactRun:
    """The plate speeds up until all has slipped."""
    problem = face.problem(modes, (STIFFNESS, DAMPING))
    start = press_contacts(problem, face.load) if face.load else None
    return step_contacts(problem, 0.24, step=step, inputs=face.load | {"surface.x": ramp(0.0, 40 * ACCELERATION, 0.0, 40.0)}, start=start)


def struck(face: Face, modes: int, step: float) -> ContactRun:
    """Half a sine of 10 N and 20 us pushes the back of the cube, which has no mount."""
    problem = face.problem(modes)
    start = press_contacts(problem, face.load) if face.load else None
    return step_contacts(problem, 80e-6, step=step, inputs=face.load | {"back": PUSH}, start=start)


PULSE = np.linspace(0.0, 20e-6, 41)
PUSH = (np.append(PULSE, 21e-6), np.append(10.0 * np.sin(np.pi * PULSE / 20e-6), 0.0))
"""The blow: times [s] and forces [N]."""


def located(face: Face, accuracy: float) -> Trajectory:
    """The struck rows with all modes, every event located."""
    body = replace(face.body, ports=tuple(port.replace("x.", "contact.") for port in face.body.ports))
    slider = ElasticSlider(body, tuple(face.options["load"]), support_port="back", stiffness=0.0, damping=0.0, friction=FRICTION)
    return simulate(compose(slider), 80e-6, inputs={"slider.pull": PUSH}, method="stiff", accuracy=accuracy)


# ------------------------------------------------------------------------------------------------------------------------------------------- measures
def force(run: ContactRun, times: np.ndarray) -> np.ndarray:
    """The friction on the face along the pull [N] at times from the begin of the run."""
    return np.interp(times, run.time - run.time[0], run.tangential[:, :, 0].sum(axis=1))


def share(run: ContactRun, times: np.ndarray) -> np.ndarray:
    """The share that sticks at these times."""
    at = np.searchsorted(run.time - run.time[0], times * (1 - 1e-9))
    return run.share()[at.clip(0, len(run.time) - 1)]


def errors(run: ContactRun, exact: ContactRun) -> tuple[float, float]:
    """Largest error of the force in parts of the largest force, and mean error of the share."""
    times = np.linspace(0.0, exact.end - exact.time[0], 241)[1:]
    largest = np.abs(force(exact, times)).max()
    return float(np.abs(force(run, times) - force(exact, times)).max() / largest), float(
        np.abs(share(run, times) - share(exact, times)).mean()
    )


def against_located(face: Face) -> Iterator[str]:
    """Lines on the struck rows: located events by accuracy, then time stepping by step, each with the error of its force against the finest located run."""
    times = np.linspace(0.0, 80e-6, 241)[1:]
    exact = located(face, 1e-10).at(times)["plate.drag"]
    size = np.abs(exact).max()
    for accuracy in (1e-8, 1e-6, 1e-4):
        run, spent = timed(lambda a=accuracy: located(face, a), 3)
        wrong = np.abs(run.at(times)["plate.drag"] - exact).max() / size
        yield f"| located to {accuracy:.0e} | {len(run.time) - 1} | {len(run.events)} | {wrong:.1e} | {spent:.2g} s |"
    for step in (1e-6, 2.5e-7, 6.25e-8):
        stepped, spent = timed(lambda s=step: struck(face, face.body.modes, s), 2)
        wrong = np.abs(force(stepped, times) - exact).max() / size
        yield f"| steps of {1e6 * step:g} us | {len(stepped.time) - 1} | {len(stepped.events)} | {wrong:.1e} | {spent:.2g} s |"


def trade(drive: Any, face: Face, settings: Iterable[tuple[int, float]]) -> Iterator[str]:
    """Lines of a table for settings (modes, step); the last is what the others are compared with, and takes one run."""
    *settings, (most, finest) = settings
    exact, longest = timed(lambda: drive(face, most, finest))
    runs = {(modes, step): timed(lambda m=modes, s=step: drive(face, m, s), 2) for modes, step in settings}
    for (modes, step), (run, spent) in runs.items():
        wrong = errors(run, exact)
        alike = runs.get((most, step))
        fewer = "-" if alike is None or modes == most else f"{errors(run, alike[0])[0]:.1e}"
        yield _line(face, modes, step, run, f"{wrong[0]:.1e} | {fewer} | {wrong[1]:.4f}", spent)
    yield _line(face, most, finest, exact, "- | - | -", longest)


def _line(face: Face, modes: int, step: float, run: ContactRun, wrong: str, spent: float) -> str:
    return f"| {face.name} | {modes} | {1e6 * step:g} us | {wrong} | {run.newton_iterations[1:].mean():.1f} | {spent:.2g} s |"


def main() -> None:
    """Print the tables."""
    rigid = Pull().rigid_time()
    row_run()  # compiles the model
    print("Eleven rows with located events: accuracy, last row lets go [s], difference to the rigid slider, events, time of the clock")
    for accuracy in (1e-4, 1e-5, 1e-6):
        run = min((row_run(accuracy) for _ in range(3)), key=lambda run: run.wall_time)
        last = first_slips(run).max()
        print(f"| {accuracy:.0e} | {last:.6f} | {last / rigid - 1:.1e} | {len(run.events)} | {run.wall_time:.2g} s |", flush=True)
    band = 200e3
    faces = []
    for made in (lambda: rows(band), lambda: nodes((10, 10, 10), band), lambda: nodes((14, 19, 10), band)):
        begun = process_time()
        faces.append(made())
        print(f"\n{faces[-1].name}: {faces[-1].body}, reduced in {process_time() - begun:.2g} s", flush=True)
    print(f"\nSlow\n\n{HEAD}")
    for face in faces:
        most, finest = face.body.modes, 1e-3 if face is faces[-1] else 5e-4
        for line in trade(slow, face, [(0, 8e-3), (0, 4e-3), (0, 2e-3), (most, 4e-3), (most, finest)]):
            print(line, flush=True)
    print("\nStruck, eleven rows with all modes, against located events: steps, changes of mode, error of force, time\n")
    for line in against_located(faces[0]):
        print(line, flush=True)
    print(f"\nStruck\n\n{HEAD}")
    for face in faces:
        most, finest = face.body.modes, 1.25e-7 if face is faces[-1] else 6.25e-8
        settings = [(0, 2.5e-7), (most // 8, 2.5e-7), (most // 2, 2.5e-7), (most, 2.5e-7), (most, 5e-7), (most, 1e-6), (most, finest)]
        for line in trade(struck, face, settings):
            print(line, flush=True)
    print("\nNodes, slow drive without modes, step 4 ms: errors against 300 nodes, and the published measures")
    exact, longest = timed(lambda: slow(faces[-1], 0, 4e-3))
    for divisions in ((2, 2, 10), (5, 5, 10), (10, 10, 10)):
        face = nodes(divisions, 0.0) if divisions[0] < 10 else faces[1]
        run, spent = timed(lambda f=face: slow(f, 0, 4e-3), 2)
        wrong = errors(run, exact)
        print(f"| {face.name} | {wrong[0]:.1e} | {wrong[1]:.4f} | {spent:.2g} s | " + published(run), flush=True)
    print(f"| {faces[-1].name} | - | - | {longest:.2g} s | " + published(exact))


def published(run: ContactRun) -> str:
    """The measures of an independent model of the same cube: shares at 0.16 and 0.20 s, end of adhesion."""
    found = measures(run)
    return " | ".join(f"{found[word]:.3g}" for word in ("share at 0.16 s", "share at 0.20 s", "no node sticks from [s]")) + " |"


if __name__ == "__main__":
    main()
