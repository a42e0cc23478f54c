"""Scenes of a body with many contacts: the body, the cases to be compared on it, and the step. Their TOML form is that of other scenes with fewer keys."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from toolbox.arguments import short
from toolbox.contacts.contact_run import ContactRun
from toolbox.contacts.problem import ContactBody, ContactProblem
from toolbox.contacts.sampled_laws import Acting, signals_of
from toolbox.contacts.stepping import instants, press_contacts, step_contacts
from toolbox.errors import SceneError, SimulationError
from toolbox.files.units import parse
from toolbox.scenes import catalogue, keys, scene_file
from toolbox.scenes.cases import Case, Labelled, Waveform
from toolbox.scenes.scene import Scene


@dataclass(frozen=True)
class ContactScene(Labelled):
    """Body with many contacts, and the cases to compare. All numbers are in SI.

    Every run begins at rest under the forces at its beginning (`press_contacts`). To load a body in time, use a force
    that begins at 0.

    Attributes
    ----------
    title
        Title of the scene.
    body
        The body, such as `models.ElasticFace`.
    duration, step
        Length of the runs and of a time step [s].
    cases
        One `Case` per controller, with different labels and sampled controllers.
    inputs
        {input of the body, or set-point of a controller: value}, for all cases. A value is a number, text with a unit,
        a table (times, values) or an expression of time. If a case has an input of the same name, the value of the case
        is used.

    Examples
    --------
    >>> from models import StringOnWall
    >>> from toolbox.scenes import ContactScene
    >>> numbers = {"mass": (5000.0,), "axial_stiffness": (4e6,), "axial_damping": (2e5,), "inertia": (2000.0, 100.0)}
    >>> string = StringOnWall(**numbers, stiffness=(2000.0,), damping=(80.0,), radius=0.1, loads=(5000.0,))
    >>> scene = ContactScene("pulled string", string, 10.0, 0.02, inputs={"hook.speed": -0.1})
    >>> print(f"{4e6 * scene.run('no controller')['axial.0'][-1]:.0f} N of drag")
    1500 N of drag
    """

    title: str
    body: ContactBody
    duration: float
    step: float
    cases: tuple[Case, ...] = (Case("no controller"),)
    inputs: Mapping[str, float | Waveform] = field(default_factory=dict)

    @staticmethod
    def load(path: str | Path) -> ContactScene:
        """Read and check the scene in a TOML file. Raises one SceneError that names the file and the fault.

        Parameters
        ----------
        path
            Path of the file.
        """
        path = Path(path)
        try:
            scene = ContactScene(**_read(path))
            scene.check()
        except SceneError as error:
            raise SceneError(f"Scene `{path}`: {error}") from None
        return scene

    def run(self, label: str) -> ContactRun:
        """Run one case, given by its label. Raises the errors of `step_contacts`, and SceneError if the body has no state of rest as a start.

        Parameters
        ----------
        label
            Label of the case.
        """
        case, problem = self.case(label), self._problem()
        rest = self._rest(problem, case)
        return step_contacts(problem, self.duration, step=self.step, inputs=self._inputs(case), controller=case.controller, start=rest)

    def check(self) -> None:
        """Raise SceneError unless every case can be stepped and has a state of rest as a start. Nothing is run."""
        problem = self._problem()
        times, _ = instants(self.duration, self.step)
        self._check_cases()
        for case in self.cases:
            try:
                Acting(problem, self._inputs(case), times, case.controller)
                self._rest(problem, case)
            except SceneError as error:
                raise SceneError(f"Controller `{case.label}`: {error}") from None

    def _problem(self) -> ContactProblem:
        if not isinstance(self.body, ContactBody):
            raise SceneError(f"Argument `body` must be a body with many contacts, such as ElasticFace, but it is {short(self.body)}.")
        return self.body.problem()

    def _rest(self, problem: ContactProblem, case: Case) -> ContactRun:
        """The body under the forces at its beginning."""
        forces = {name: value for name, value in self._inputs(case).items() if name in problem.force_inputs}
        acting = Acting(problem, forces, np.zeros(1))
        try:
            return press_contacts(problem, {name: float(value[0]) for name, value in acting.values.items()})
        except (SceneError, SimulationError) as error:
            raise SceneError(f"the body must be at rest under the forces at its beginning, but: {error}") from None

    def _inputs(self, case: Case) -> dict[str, Any]:
        return {name: value.build() if isinstance(value, Waveform) else value for name, value in {**self.inputs, **case.inputs}.items()}


def load_scene(path: str | Path) -> Scene | ContactScene:
    """The checked scene of a TOML file, of the kind that its plant asks for. Raises SceneError as `Scene.load` does."""
    try:
        data = scene_file._data(Path(path))
        stepped = "step" in data or scene_file.contact_body(data) is not None
    except SceneError as error:
        raise SceneError(f"Scene `{path}`: {error}") from None
    return ContactScene.load(path) if stepped else Scene.load(path)


def _read(path: Path) -> dict[str, Any]:
    """The fields of a ContactScene in a TOML file."""
    data = scene_file._data(path)
    name, entries = scene_file.contact_body(data), scene_file._tables(data, "plant")
    if name is None:
        for i, entry in enumerate(entries, 1):
            catalogue.part(
                scene_file._keys(entry, f"plant[{i}]", None, ("part",))["part"]
            )  # raises the error that says why, for an unknown name
        raise SceneError("a scene with a `step` must be about a body with many contacts, such as ElasticFace, but its plant has equations.")
    scene_file._keys(data, "the scene", keys.names(keys.CONTACTS), keys.required(keys.CONTACTS))
    if len(entries) > 1:
        raise SceneError(f"Argument `plant` must be `{name}` alone, but it has {len(entries)} entries.")
    body = scene_file._component(entries[0], name, path.parent, "contact body")
    controllers = scene_file._tables(data, "controllers")
    plant = signals_of(body.problem(), any(isinstance(entry, dict) and "law" in entry for entry in controllers))
    cases = tuple(scene_file._case(entry, f"controllers[{i}]", plant, None) for i, entry in enumerate(controllers, 1))
    given = data.get("inputs", {})
    return {
        "title": scene_file._text(data["title"], "title"),
        "body": body,
        "duration": parse(data["duration"], "s", "duration"),
        "step": parse(data["step"], "s", "step"),
        "cases": cases or (Case("no controller"),),
        "inputs": scene_file.inputs_of(given, "inputs", plant, cases),
    }
