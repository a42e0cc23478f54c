"""Sections of the folders that commands write."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from toolbox.calibration.identified import Identification
from toolbox.calibration.results import Fit
from toolbox.drilling.answer_results import Answers
from toolbox.drilling.depth_windows import Windows
from toolbox.drilling.estimates import Estimates
from toolbox.drilling.gain_schedule import Schedule
from toolbox.drilling.lowest_set_point import LowestSetPoints
from toolbox.errors import SceneError
from toolbox.files.origin import ORIGIN, Origin
from toolbox.files.printing import table
from toolbox.files.reading import text_of
from toolbox.measuring.verdict import Verdict
from toolbox.onsets.comparison import Comparison
from toolbox.onsets.results import Onset
from toolbox.onsets.severity_map import SeverityMap
from toolbox.probability.basins import Basin
from toolbox.probability.drawn_borders import UncertainOnset
from toolbox.probability.posteriors import Posterior
from toolbox.probability.results import Chance
from toolbox.reports.figures import KINDS, caption_of, figures_of_folder
from toolbox.reports.first_page import Findings, of_answers, of_study
from toolbox.reports.machine import usual_units
from toolbox.reports.sections import Section, preformatted
from toolbox.robustness.joint_errors import SmallestError
from toolbox.robustness.margins import Margins
from toolbox.scenes import catalogue
from toolbox.scenes.contact_scene import load_scene
from toolbox.scenes.scene import Scene
from toolbox.scenes.verdict_table import in_cells, judged_by, read_table, remarks
from toolbox.scenes.work_precision import WorkPrecision
from toolbox.simulation.trajectory import Trajectory
from toolbox.sweeps.results import Sweep
from toolbox.tuning.results import Tuned


@dataclass(frozen=True)
class Kind:
    """Output of a command: the file that identifies it, its name, its figure, and functions that read its answer and its verdicts from the
    folder.

    beside: names of other figures that are shown with the answer.
    """

    mark: str
    name: str
    figure: str
    answer: Callable[[Path, Scene | None], tuple[str, tuple[str, ...]]] | None = None
    findings: Callable[[Path, Scene | None], Findings | None] | None = None
    beside: Sequence[str] = ()


def of_folder(folder: Path) -> list[Section]:
    """The sections of a folder of results, or of all folders of results in it.

    A symbolic link in a folder is not followed: a figure that is one is left out, and a section tells so. The folder itself may be one.

    Raises SceneError where there are none, where one is damaged, and where anything else than a figure in a folder of results is a symbolic link.
    """
    if not folder.is_dir():
        raise SceneError(f"Argument `results` must be folders of results, but there is no folder `{folder}`.")
    kind = next((each for each in ALL if (folder / each.mark).is_file()), None)
    if kind is not None:
        return [_section(folder, kind)]
    inner = [path for path in folder.iterdir() if path.is_dir() and not path.is_symlink()]
    inner += [path for above in inner for path in above.iterdir() if path.is_dir() and not path.is_symlink()]
    places = sorted(path for path in inner if (path / ORIGIN).is_file())
    found = [section for place in places for section in of_folder(place)]  # a map or a sweep has a folder in its folder for each controller
    if not found:
        raise SceneError(f"Argument `results` must be folders that a command of `stickslip` wrote, but `{folder}` is none.")
    return found


def _section(folder: Path, kind: Kind) -> Section:
    links = _links(folder)
    scene = load_scene(folder / "scene.toml") if (folder / "scene.toml").is_file() else None
    text = text_of(folder / kind.mark) if kind.mark.endswith(".txt") else ""
    origin = Origin.read(folder) if (folder / ORIGIN).is_file() else None
    remarks: tuple[str, ...] = ()
    if origin is not None and (changed := origin.changed(folder)):
        remarks = (f"Changed since they were written, or gone: {', '.join(changed)}.",)
    if links:
        remarks += (f"Left out, because they are symbolic links: {', '.join(path.name for path in links)}.",)
    declared = scene if isinstance(scene, Scene) else None
    first, _, below = text.strip().partition("\n")
    loops = tuple((label, declared[label]) for label in declared.labels) if declared else ()
    with usual_units(loops[0][1] if loops else None):
        answer, more = kind.answer(folder, declared) if kind.answer else (preformatted(below.strip("\n") or text), ())
        findings = kind.findings(folder, declared) if kind.findings else None
    title = getattr(scene, "title", "") or first or kind.name
    own, others = figures_of_folder(folder, kind.figure, f"{kind.name}: {title}", _labels(declared), kind.beside)
    return Section(
        title,
        kind.name,
        answer,
        own,
        others,
        text,
        loops,
        origin,
        folder,
        more + remarks,
        findings,
    )


def _links(folder: Path) -> list[Path]:
    """Figures in a folder that are symbolic links. Raises SceneError where anything else is one."""
    links = sorted(path for path in folder.rglob("*") if path.is_symlink())
    if followed := [path for path in links if path.suffix not in KINDS or path.parent != folder]:
        raise SceneError(
            f"A folder of results must hold no symbolic links, but `{followed[0]}` is one, and a report would show the file to which it leads."
        )
    return links


def _labels(scene: Scene | None) -> list[str]:
    """Labels of the controllers of a scene, in order."""
    return [] if scene is None else scene.labels


# ---------------------------------------------------------------------------------------------------------------------------------------- answers
def _study(folder: Path, scene: Scene | None) -> tuple[str, tuple[str, ...]]:
    if scene is None:
        raise SceneError(f"Folder `{folder}` must hold the scene of its study, but there is no `scene.toml` with equations.")
    rows = read_table(folder / "table.csv")
    head, *cells = in_cells(scene, rows, times=False)
    return table(judged_by(scene, rows), head, cells), tuple(remarks(rows))


def _study_findings(folder: Path, scene: Scene | None) -> Findings | None:
    """The verdicts of a study as values; None for a table of an earlier version, which has their words alone."""
    rows = read_table(folder / "table.csv")
    return of_study(scene, rows) if scene is not None and all(isinstance(row.verdict, Verdict) for row in rows) else None


def _answer_findings(folder: Path, scene: Scene | None) -> Findings | None:
    return of_answers(Answers.load(folder / "answer.npz")) if (folder / "answer.npz").is_file() else None


def _onset(folder: Path, scene: Scene | None) -> tuple[str, tuple[str, ...]]:
    found = {}
    for path in sorted(folder.glob("[0-9][0-9]_*_onset.npz")):
        onset = Onset.load(path)
        found[onset.title or path.stem] = onset
    parts = [Comparison(found, {})._repr_html_()] if len(found) > 1 else []
    parts += [_short(onset, label) for label, onset in found.items()]
    return "\n".join(parts), _failures(folder)


def _loaded(report: str, *kinds: tuple[Any, str]) -> Callable[[Path, Scene | None], tuple[str, tuple[str, ...]]]:
    """How the answer of a folder is read whose results say themselves; report: the file with what was printed;  kinds: (kind, pattern of files) of results."""

    def answer(folder: Path, scene: Scene | None) -> tuple[str, tuple[str, ...]]:
        found = {path: kind.load(path)._repr_html_() for kind, pattern in kinds for path in sorted(folder.glob(pattern))}
        if not found:  # of an earlier version
            return preformatted(text_of(folder / report)), ()
        parts = (
            found.values()
            if len(found) == 1
            else [f"<h3>{escape(caption_of(path, _labels(scene)))}</h3>{told}" for path, told in found.items()]
        )
        return "\n".join(parts), _failures(folder)

    return answer


def _one(title: str, name: str, kind: Any, findings: Any = None) -> Kind:
    """A folder with one result: its file, what was printed and the figure bear one name."""
    return Kind(f"{name}.txt", title, name, _loaded(f"{name}.txt", (kind, f"{name}.npz")), findings)


def _torque_drag(folder: Path, scene: Scene | None) -> tuple[str, tuple[str, ...]]:
    """Friction factors, operations of a rig and effects of numbers; their classes are those of the part, which stands above this room."""
    results = catalogue.part("DrillString").torque_drag_results
    return _loaded("torquedrag.txt", *((kind, f"{name}.npz") for name, kind in results.items()))(folder, scene)


def _simulation(folder: Path, scene: Scene | None) -> tuple[str, tuple[str, ...]]:
    """The runs of a machine of equations, each with its measures; what was printed of a body with many contacts."""
    if scene is None:
        return preformatted(text_of(folder / "simulate.txt")), ()
    return _loaded("simulate.txt", (Trajectory, "[0-9][0-9]_*.npz"))(folder, scene)


def _short(onset: Onset, label: str) -> str:
    """The borders of one controller and what they mean; the values that were simulated stand in the appendix."""
    return table(label, (), (), [onset.advice, *onset.notes])


def _drives(folder: Path, scene: Scene | None) -> tuple[str, tuple[str, ...]]:
    """The lowest set-points with what they leave and what they cost; all columns stand in the appendix."""
    if not (folder / "setpoints.npz").is_file():  # of an earlier version
        return preformatted(text_of(next(folder / name for name in ("setpoints.txt", "drives.txt") if (folder / name).is_file()))), ()
    found = LowestSetPoints.load(folder / "setpoints.npz")
    head, *cells = found.answer_rows
    return table(found.title, head, cells), _failures(folder)


def _failures(folder: Path) -> tuple[str, ...]:
    """Which controllers have no answer in a folder, and why."""
    failures = Origin.read(folder).failures if (folder / ORIGIN).is_file() else {}
    return tuple(f"{label}: {why}" for label, why in failures.items())


ALL: Sequence[Kind] = (
    _one("Answers for every controller", "answer", Answers, _answer_findings),
    Kind("study.txt", "Study", "comparison", _study, _study_findings),
    Kind("onset.txt", "Onset of stick-slip", "onset", _onset),
    _one("Onset of stick-slip of machines that are drawn", "drawn_onset", UncertainOnset),
    _one("Severity map", "map", SeverityMap),
    _one("Chance of stick-slip", "chance", Chance),
    _one("Basin of a working point", "basin", Basin),
    _one("Gains over depth", "schedule", Schedule),
    _one("Windows over depth", "windows", Windows),
    _one("Posterior", "posterior", Posterior),
    _one("Estimates beside the rig", "estimate", Estimates),
    Kind(
        "margins.txt",
        "Margins",
        "margins",
        _loaded("margins.txt", (Margins, "[0-9][0-9]_*_margins.npz"), (SmallestError, "[0-9][0-9]_*_error.npz")),
    ),
    Kind("setpoints.txt", "Lowest set-points", "setpoints", _drives),
    Kind("drives.txt", "Lowest set-points", "drives", _drives),
    _one("Tuning", "tune", Tuned),
    _one("Calibration", "fit", Fit),
    Kind("identify.txt", "Identification", "friction", _loaded("identify.txt", (Identification, "identify.npz"))),
    Kind("torquedrag.txt", "Torque and drag", "torquedrag", _torque_drag, beside=("friction_factors", "effects")),
    Kind("simulate.txt", "Simulation", "01", _simulation),
    Kind("compare.txt", "Comparison", "compare"),
    _one("Error against time", "tradeoff", WorkPrecision),
    Kind("sweep.txt", "Sweep", "sweep", _loaded("sweep.txt", (Sweep, "sweep.npz"), (Sweep, "sweep.zarr"))),
    Kind("tradeoff.csv", "Error against time", "tradeoff"),
    Kind("sweep.csv", "Sweep", "sweep"),
)
"""What the commands write; `drives.txt` and the last two are of earlier versions."""
