"""Runs of many contacts: states, forces and energies step by step, with measures of where a face sticks."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from toolbox.arguments import number
from toolbox.contacts.problem import LEGEND, OPEN, SLIP, STICK, ContactProblem
from toolbox.errors import SceneError, suggest
from toolbox.files.archives import Shape, arrays, check_shapes, understood
from toolbox.files.atomic import replaced
from toolbox.files.results import read, written
from toolbox.files.tables import write as write_table
from toolbox.files.units import NumberOrText
from toolbox.modelling.elements import FrictionLaw
from toolbox.simulation.samples import Event
from toolbox.vocabulary import Renamed, new_field


class Energies:
    """Energies [J] at every step: kinetic and elastic as they are, all others summed up from the begin of the run.

    work: {input: what its force puts in}.  surface: what the counter-surface puts in.  friction is in `ContactRun.friction_work`.  damping: what the
    damping takes.  impacts: what closing contacts take, normal and tangential.  stepping: what the time stepping takes from motions that it cannot follow.
    """

    def __init__(self, rows: int, inputs: Iterable[str]):
        self.kinetic, self.elastic, self.damping, self.stepping = (np.zeros(rows) for _ in range(4))
        self.surface, self.impacts = np.zeros(rows), np.zeros(rows)
        self.work = {name: np.zeros(rows) for name in inputs}

    def cut(self, rows: int) -> Energies:
        """The first rows."""
        kept = Energies(0, ())
        for word, values in vars(self).items():
            setattr(kept, word, {name: v[:rows] for name, v in values.items()} if isinstance(values, dict) else values[:rows])
        return kept


RECORDS = ("time", "coordinates", "rates", "contact_modes", "normal", "tangential", "slip", "friction_work", "newton_iterations")
"""Arrays of a run in its file, in the order of its fields."""


def _law_named(name: str) -> type[FrictionLaw]:
    """The friction law of that name, of all that are defined; raises SceneError where there is none."""
    left = [FrictionLaw]
    while left:
        kind = left.pop()
        if f"{kind.__module__}.{kind.__qualname__}" == name:
            return kind
        left += kind.__subclasses__()
    raise SceneError(f"The run has the friction law `{name}`, which is not known here: import its module first.")


@dataclass
class ContactRun(Renamed):
    """Result of `step_contacts` at t instants.

    `run["back"]` is the displacement of an output of the problem [m], shape (t,). `run["back.speed"]` is its speed
    [m/s].

    Attributes
    ----------
    time
        Instants [s], shape (t,).
    coordinates, rates
        Coordinates q and their rates, shape (t, n).
    contact_modes
        Modes of the contacts, shape (t, c): 0 stick, 1 slip, 2 open.
    normal
        Normal forces [N], >= 0, shape (t, c).
    tangential
        Tangential forces on the body [N], shape (t, c, k).
    slip
        Slipped distances since the beginning, with sign [m], shape (t, c, k).
    friction_work
        Energy that friction has dissipated at every contact [J], shape (t, c).
    energy
        {name: energies of the body and of its inputs [J]}. The method `audit` compares them.
    newton_iterations
        Newton iterations of every step, shape (t,).
    inputs
        {name: values, shape (t,)}. For a signal that a controller gives, the value over the step that ends at the
        instant.
    problem
        The `ContactProblem`.
    wall_time
        Computing time [s].

    Examples
    --------
    >>> from models import AxialChain, Coulomb, TorsionalChain, string_on_wall
    >>> from toolbox.contacts import step_contacts
    >>> axial = AxialChain(mass=(5000.0,), stiffness=(4e6,), damping=(2e5,))
    >>> torsional = TorsionalChain(inertia=(2000.0, 100.0), stiffness=(2000.0,), damping=(80.0,))
    >>> string = string_on_wall(axial, torsional, radius=0.1, loads=(5000.0,), friction=Coulomb(0.3, 0.3))
    >>> run = step_contacts(string, "10 s", step=0.02, inputs={"hook.speed": -0.1})
    >>> print(f"{run.friction_work[-1, 0]:.0f} J of friction work in {run.end:.0f} s")
    1499 J of friction work in 10 s
    """

    problem: ContactProblem
    time: np.ndarray
    coordinates: np.ndarray
    rates: np.ndarray
    contact_modes: np.ndarray
    normal: np.ndarray
    tangential: np.ndarray
    slip: np.ndarray
    friction_work: np.ndarray
    energy: Energies
    newton_iterations: np.ndarray
    inputs: dict[str, np.ndarray] = field(default_factory=dict)
    wall_time: float = 0.0
    _finer: Callable[[], ContactRun] | None = field(default=None, repr=False)

    def __getitem__(self, name: str) -> np.ndarray:
        output, _, word = name.rpartition(".") if isinstance(name, str) else ("", "", "")
        if name not in self.problem.outputs and output in self.problem.outputs and word in ("position", "speed"):
            return self.rate(output) if word == "speed" else self[output]
        return self.coordinates @ self._output(name)

    def rate(self, name: str) -> np.ndarray:
        """Return the speed of an output of the problem [m/s], shape (t,).

        Parameters
        ----------
        name
            Name of the output.
        """
        return self.rates @ self._output(name)

    def _output(self, name: str) -> np.ndarray:
        if name not in self.problem.outputs:
            raise SceneError(f"There is no output `{name}`: {suggest(name, self.problem.outputs)}")
        return self.problem.outputs[name]

    @property
    def end(self) -> float:
        """The last instant [s]."""
        return float(self.time[-1])

    @property
    def pressure(self) -> np.ndarray:
        """Normal forces per area [Pa], shape (t, c). [N] if the problem has no areas."""
        return self.normal / self.problem.contact_areas

    @property
    def traction(self) -> np.ndarray:
        """Magnitudes of the tangential forces per area [Pa], shape (t, c). [N] if the problem has no areas."""
        return np.linalg.norm(self.tangential, axis=2) / self.problem.contact_areas

    def share(self, mode: str = "stick") -> np.ndarray:
        """Return the fraction of the total contact area that is in a mode ("stick", "slip" or "open"), shape (t,).

        Parameters
        ----------
        mode
            Mode of the contacts: "stick" (default), "slip" or "open".
        """
        return (self.contact_modes == _code(mode)) @ self.problem.contact_areas / self.problem.contact_areas.sum()

    def last(self, mode: str = "stick") -> float:
        """Return the last instant [s] with at least one contact in a mode. nan if there is no such instant.

        Parameters
        ----------
        mode
            Mode of the contacts: "stick" (default), "slip" or "open".
        """
        found = np.flatnonzero((self.contact_modes == _code(mode)).any(axis=1))
        return float(self.time[found[-1]]) if found.size else float("nan")

    def first(self, mode: str) -> float:
        """Return the first instant [s] with all contacts in a mode. nan if there is no such instant.

        Parameters
        ----------
        mode
            Mode of the contacts: "stick", "slip" or "open".
        """
        found = np.flatnonzero((self.contact_modes == _code(mode)).all(axis=1))
        return float(self.time[found[0]]) if found.size else float("nan")

    @property
    def events(self) -> list[Event]:
        """Changes of mode in order, each at the end of its step. The element is `contact.i`."""
        steps, contacts = np.nonzero(np.diff(self.contact_modes.astype(int), axis=0))
        return [
            Event(float(self.time[i + 1]), f"contact.{c}", LEGEND[int(self.contact_modes[i, c])], LEGEND[int(self.contact_modes[i + 1, c])])
            for i, c in zip(steps, contacts, strict=True)
        ]

    def audit(self) -> dict[str, float]:
        """Return the energy balance of the run [J].

        supplied = stored + friction + damping + impacts + stepping + missing. `stepping` is the energy error of the
        time stepping, which decreases with the step. `missing` is the rest, which is round-off. `size` is the largest
        of these energies.
        """
        energy = self.energy
        stored = energy.kinetic + energy.elastic
        parts = {
            "supplied": float(sum(work[-1] for work in energy.work.values()) + energy.surface[-1]),
            "stored": float(stored[-1] - stored[0]),
            "friction": float(self.friction_work[-1].sum()),
            "damping": float(energy.damping[-1]),
            "impacts": float(energy.impacts[-1]),
            "stepping": float(energy.stepping[-1]),
        }
        parts["missing"] = 2 * parts["supplied"] - sum(parts.values())
        parts["size"] = float(max(np.abs(stored).max(), *(abs(value) for value in parts.values())))
        return parts

    @cached_property
    def error_estimate(self) -> float:
        """Estimated error of the run: the largest error of displacements and of impulses of contact forces, from a second run with half the step.

        - Displacements of the contacts, and outputs in m, are compared at each instant as one vector, relative to the
          largest motion of the run. Outputs with another unit are compared separately in the same way.
        - Impulses of all contacts, from the beginning of the run on, are compared relative to the largest impulse.
          Forces are not compared: a force jumps when a contact slips, and a jump that is one step late is equally large
          for every step.

        The error falls with the first power of the step, so the error of the run is twice the difference. It is 0 for a
        state of rest, which has no step, and nan for a run that failed.
        """
        if self._finer is None:
            return 0.0 if len(self.time) == 1 else float("nan")
        runs = (self, self._finer())
        rows: dict[str, list[np.ndarray]] = {"m": list(self.problem.displacements())}
        for name, row in self.problem.outputs.items():
            rows.setdefault(self.problem.output_unit(name), []).append(row)
        pairs, least = [], []
        for each in map(np.array, rows.values()):
            pairs.append([(run.coordinates - run.coordinates[0]) @ each.T for run in runs])
            least.append(1e-9 * float((np.abs(runs[1].coordinates) @ np.abs(each.T)).max()))  # below it is round-off of larger motions
        forces = [np.concatenate([run.normal[..., None], run.tangential], axis=2).reshape(len(run.time), -1) for run in runs]
        pairs.append([np.cumsum(force[1:], axis=0)[k :: k + 1] / (k + 1) for k, force in enumerate(forces)])
        worst = 0.0
        for (mine, theirs), floor in zip(pairs, [*least, 0.0], strict=True):
            size = np.linalg.norm(theirs, axis=1).max()
            theirs = theirs if len(theirs) == len(mine) else theirs[::2]
            if size > floor:
                worst = max(worst, float(2 * np.linalg.norm(mine - theirs, axis=1).max() / size))
        return worst

    def save(self, path: str | Path) -> Path:
        """Write the run to a file, atomically: a compressed npz file without pickle, which `load` reads, or a table if the path ends with .csv.

        Keys of the npz file:

        - the arrays of the attributes by their names;
        - `contact_areas` and, if they are known, `contact_positions`;
        - `output.<name>`, `output.<name>.speed` and `input.<name>`;
        - `energy.<word>` for the entries of `energy`;
        - `run` (JSON), and the arrays that it names for the problem.

        Parameters
        ----------
        path
            Path of the file.
        """
        path = Path(path)
        if path.suffix == ".csv":
            return self.to_csv(path)
        columns: dict[str, Any] = {word: getattr(self, word) for word in RECORDS}
        columns |= {
            word: getattr(self.problem, word) for word in ("contact_areas", "contact_positions") if getattr(self.problem, word) is not None
        }
        for name in self.problem.outputs:
            columns |= {f"output.{name}": self[name], f"output.{name}.speed": self.rate(name)}
        columns |= {f"input.{name}": values for name, values in self.inputs.items()}
        for word, values in vars(self.energy).items():
            columns |= (
                {f"energy.{word}.{name}": each for name, each in values.items()} if isinstance(values, dict) else {f"energy.{word}": values}
            )
        law = self.problem.friction
        own = {each.name: getattr(self.problem, each.name) for each in dataclasses.fields(self.problem) if each.name != "friction"}
        held: dict[str, Any] = {}
        tree = written(
            {"problem": own, "law": f"{type(law).__module__}.{type(law).__qualname__}", "friction": vars(law), "wall_time": self.wall_time},
            held,
        )
        with replaced(path) as file:
            np.savez_compressed(file, run=np.array(json.dumps(tree)), **columns, **held)
        return path

    @staticmethod
    def load(path: str | Path) -> ContactRun:
        """Read a run from a file of `save`, without `error_estimate`, which needs another run.

        Parameters
        ----------
        path
            Path of the file. The module that defines the friction law must have been imported.

        Raises
        ------
        SceneError
            If `save` did not write this file, or the class of its friction law has not been imported.
        """
        what = "a run written by `ContactRun.save`"
        with understood(Path(path), what):
            data = {new_field(ContactRun, word): values for word, values in arrays(Path(path), what).items()}  # as earlier trees wrote them
            tree = dict(json.loads(str(data["run"])))
            kind = _law_named(tree["law"])
            problem = {
                new_field(ContactProblem, word): value for word, value in read(Mapping[str, Any], tree["problem"], data, "problem").items()
            }
            mappings = {
                word: read(Mapping[str, Any], problem[word], data, word)
                for word in ("force_inputs", "surface_velocity", "outputs", "units")
            }
            law = kind(**read(Mapping[str, Any], tree["friction"], data, "friction"))
            inputs = {name.removeprefix("input."): values for name, values in data.items() if name.startswith("input.")}
            energy = Energies(0, ())
            for word in vars(energy):
                own = f"energy.{word}"
                sums = {name.removeprefix(f"{own}."): values for name, values in data.items() if name.startswith(f"{own}.")}
                setattr(energy, word, sums if word == "work" else data[own])
            records: dict[str, Any] = {word: data[word] for word in RECORDS}
            held = ContactProblem(**{**problem, **mappings, "friction": law})
            run = ContactRun(problem=held, energy=energy, inputs=inputs, wall_time=float(tree["wall_time"]), **records)
            run._check(data)
        return run

    def _check(self, data: Mapping[str, np.ndarray]) -> None:
        """Raise ValueError where arrays that were read do not fit to one another and to the problem."""
        problem, n, c, k = self.problem, self.problem.size, self.problem.contacts, self.problem.directions
        shapes: dict[str, Shape] = {
            "time": ("f", "t"),
            "coordinates": ("f", "t", n),
            "rates": ("f", "t", n),
            "contact_modes": ("iu", "t", c),
        }
        shapes |= {"normal": ("f", "t", c), "tangential": ("f", "t", c, k), "slip": ("f", "t", c, k), "friction_work": ("f", "t", c)}
        shapes |= {f"input.{name}": ("f", "t") for name in (*problem.force_inputs, *problem.surface_velocity)}
        shapes |= {name: ("f", "t") for name in data if name.startswith("energy.")}
        check_shapes(data, shapes)

    def to_csv(self, path: str | Path) -> Path:
        """Write the behaviour of the whole face as CSV in SI, with units in the headings and one row per instant. Return the path.

        Columns: fractions of the area that stick, slip and are open; sums of the contact forces; energies; inputs;
        outputs with their speeds. With more than 20 contacts, outputs that are displacements of a contact are left out.
        The file of `save` contains the behaviour of every contact. The file is written atomically.

        Parameters
        ----------
        path
            Path of the file.
        """
        problem, energy = self.problem, self.energy
        columns: dict[str, np.ndarray] = {"time [s]": self.time}
        columns |= {word: self.share(word) for word in ("stick", "slip", "open")}
        columns["normal force [N]"] = self.normal.sum(axis=1)
        columns |= {f"{word} force [N]": force for word, force in self._friction().items()}
        columns["taken by friction [J]"] = self.friction_work.sum(axis=1)
        columns |= {f"{word} energy [J]": getattr(energy, word) for word in ("kinetic", "elastic")}
        columns |= {f"taken by {word} [J]": getattr(energy, word) for word in ("damping", "impacts", "stepping")}
        columns |= {f"{name} [{problem.unit(name)}]": values for name, values in self.inputs.items()}
        moves = problem.displacements() if problem.contacts > 20 else np.empty((0, problem.size))
        own = {row.tobytes() for row in (*moves, *(0.0 - moves))}
        for name, row in problem.outputs.items():
            if row.tobytes() not in own:
                unit = problem.output_unit(name)
                columns |= {f"{name} [{unit}]": self[name], f"{name}.speed [{unit}/s]": self.rate(name)}
        return write_table(path, list(columns), np.column_stack(list(columns.values())).tolist())

    def plot(self) -> Any:
        """Draw fractions of the area and contact forces over time and, if the positions are known, the face at four instants.

        The instants are chosen so that the numbers of mode changes between them are equal. Pressure and traction are
        drawn at the last of the four instants, and the friction work at the end of the run. Returns the axes.
        """
        from toolbox.contacts.figures import draw_run

        return draw_run(self)

    def plot_share(self, ax: Any = None) -> Any:
        """Draw the fractions of the area that stick, slip and are open over time, and return the axes.

        Parameters
        ----------
        ax
            Matplotlib axes to draw on. By default None: a new figure.
        """
        from toolbox.contacts.figures import draw_shares

        return draw_shares(self.time, {word: self.share(word) for word in ("stick", "slip", "open")}, ax)

    def plot_forces(self, ax: Any = None) -> Any:
        """Draw the sums of the contact forces over time, normal and along each direction; returns the axes.

        Parameters
        ----------
        ax
            Matplotlib axes to draw on. By default None: a new figure.
        """
        from toolbox.contacts.figures import draw_forces

        return draw_forces(self.time, {"normal": self.normal.sum(axis=1)} | self._friction(), ax)

    def _friction(self) -> dict[str, np.ndarray]:
        return {f"tangential {i}": self.tangential[:, :, i].sum(axis=1) for i in range(self.problem.directions)}

    def plot_map(self, time: NumberOrText | None = None, values: str = "mode", ax: Any = None) -> Any:
        """Draw a quantity of every contact on the face at an instant [s], by default at the end of the run.

        `values` chooses the quantity: "mode" (default), "pressure", "traction" or "friction_work". Return the axes.

        Parameters
        ----------
        time
            Instant that is drawn [s], or text with a unit. By default the end of the run.
        values
            Quantity that is drawn: "mode" (default), "pressure", "traction" or "friction_work".
        ax
            Matplotlib axes to draw on. By default None: a new figure.
        """
        from toolbox.contacts.figures import draw_field, draw_modes

        if self.problem.contact_positions is None:
            raise SceneError("Argument `contact_positions` of the problem must be given for a picture of its contacts.")
        time = number("time", self.end if time is None else time, "s", at_least=self.time[0], at_most=self.end * (1 + 1e-12))
        i = int(np.argmin(np.abs(self.time - time)))
        plane = face_of(self.problem.contact_positions)
        if values == "mode":
            return draw_modes(plane, self.contact_modes[i], ax)
        if values not in ("pressure", "traction", "friction_work"):
            raise SceneError(f"Argument `values` must be mode, pressure, traction or friction_work, but it is {values!r}.")
        field = getattr(self, values)[i]
        energies = ((1.0, "J"), (1e3, "mJ"), (1e6, "uJ"), (1e9, "nJ"))
        large = [entry for entry in energies if entry[0] * np.abs(field).max() >= 1.0]
        factor, unit = (1e-6, "MPa") if values != "friction_work" else large[0] if large else energies[-1]
        return draw_field(plane, factor * field, f"{values.replace('_', ' ')} [{unit}]", ax)

    def animate(self, path: Any, frames: int = 60, seconds: float = 6.0) -> None:
        """Write an animation (.gif) that shows which contacts of the face stick, slip and are open, and the fraction of
        the area that sticks over time.

        `frames` is the number of pictures (default 60), and `seconds` the length of the animation [s] (default 6).

        Parameters
        ----------
        path
            Path of the file, with the ending .gif.
        frames
            Number of pictures, by default 60.
        seconds
            Length of the animation [s], by default 6.
        """
        from toolbox.contacts.figures import write_animation

        if self.problem.contact_positions is None:
            raise SceneError("Argument `contact_positions` of the problem must be given for a picture of its contacts.")
        write_animation(path, (self.time, face_of(self.problem.contact_positions), self.contact_modes, self.share()), frames, seconds)

    def __str__(self) -> str:
        now = ", ".join(f"{self.share(word)[-1]:.0%} {word}" for word in ("stick", "slip", "open"))
        took = "" if np.isnan(self.wall_time) else f", {self.wall_time:.2g} s"
        steps = (
            f"{len(self.time) - 1} steps to {self.end:g} s, {self.problem.contacts} contacts ({now} at the end), "
            f"{self.newton_iterations.sum() / max(len(self.time) - 1, 1):.1f} passes a step{took}"
        )
        share, audit, last = self.share(), self.audit(), self.last()
        still = (
            "no contact sticks"
            if np.isnan(last)
            else "contacts stick to the end"
            if last == self.time[-1]
            else f"the last contact sticks at {last:.4g} s"
        )
        told = {
            word: value if abs(value) > 1e-12 * audit["size"] else 0.0 for word, value in audit.items() if word not in ("missing", "size")
        }
        taken = ", ".join(f"{word} {value:.3g} J" for word, value in told.items())
        error = f"error {self.error_estimate:.1e}" if "error_estimate" in self.__dict__ else "error: ask `run.error_estimate`"
        return f"{steps}\n  {error}\n  share that sticks {share.min():.0%} .. {share.max():.0%}, {still}\n  energy: {taken}"


def face_of(places: np.ndarray) -> np.ndarray:
    """(c, 2) the two coordinates that vary most, in their order; a row of contacts gets a second one of zeros."""
    if places.shape[1] == 1:
        return np.column_stack([places, np.zeros(len(places))])
    widest = np.sort(np.argsort(np.ptp(places, axis=0), kind="stable")[-2:])
    return places[:, widest]


def _code(mode: str) -> int:
    codes = {"stick": STICK, "slip": SLIP, "open": OPEN}
    if mode not in codes:
        raise SceneError(f"Argument `mode` must be stick, slip or open, but it is {mode!r}.")
    return codes[mode]
