"""Write the pages that follow from the code: the reference of public names, the keys of a scene file, the sources that docstrings cite, and the drive table.

python docs/generate.py          (a test says when the pages are no longer up to date)
"""

from __future__ import annotations

import ast
import csv
import dataclasses
import importlib
import importlib.util
import inspect
import math
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from pkgutil import iter_modules
from typing import Any

FOLDER = Path(__file__).parent
ROOT = FOLDER.parent
PACKAGES = ("toolbox", "models", "controllers")
THEMES = {
    "plant": ("Plants, contacts and controllers", "Parts, contacts and controllers, and the plant or loop that they form.", "modelling"),
    "inputs": ("Inputs in time", "Shapes of inputs: steps, ramps, sines, noise.", "toolbox.inputs"),
    "simulate": ("Simulate", "Runs of a plant: methods, their accuracy and cost, results.", "simulation"),
    "figures": (
        "Figures and pages",
        "Figures of runs, spectrograms, films, and the page that changes numbers of a loop.",
        "toolbox.plot figures page",
    ),
    "scenes": ("Scenes", "Scenes with several controllers, files, units and comparisons.", "scenes files"),
    "contacts": ("Bodies with many contacts", "Elastic bodies with many contacts, simulated in time steps.", "contacts"),
    "errors": ("Errors and warnings", "What the toolbox raises, and what each error means.", "toolbox.errors errors"),
    "measure": ("Metrics of a run", "Numbers of a run: severity, stick phases, settling, energy.", "measuring"),
    "calibration": ("Calibration", "Parameters from measurements.", "calibration"),
    "steady_states": (
        "Steady states and stability",
        "Steady states, linear systems, Hopf points, impedances and vibration modes.",
        "steady_states",
    ),
    "cycles": ("Onset, cycles and maps", "Borders of stick-slip, limit cycles, their branches and derivatives of runs.", "onsets orbits"),
    "sweeps": ("Sweeps", "Many runs over several numbers.", "sweeps"),
    "probability": ("Probabilities", "Chance of stick-slip, posteriors from measurements, predictions.", "probability"),
    "robustness": ("Robustness", "Margins, frequency responses, worst cases and limits.", "robustness"),
    "drilling": ("Drilling", "Set-points, windows, gains over depth and estimates for drill strings.", "drilling"),
    "tune": ("Tuning", "Gains by search.", "tuning"),
    "report": ("Reports", "Results on one page.", "reports"),
    "export": ("Export", "Controllers and plants as C, FMU and python-control systems, and the way back.", "export"),
}
"""{page: (title, contents, rooms or modules whose public names stand on it)}; a test says when a name has no page."""
SHELVES = {
    "models": {
        "strings": ("Drill strings", "sections pipe_sizes shaft drill_string tabulated_string axial top_drive wells"),
        "boreholes": (
            "Boreholes, torque and drag",
            "survey torque_and_drag friction_calibration drag_effects wall_friction lateral",
        ),
        "bits": ("Bits and rocks", "bit_rock smooth_bit_rock hysteretic_bit_rock drag_bit elastic_rock"),
        "friction": ("Friction laws", "friction bristles rate_and_state bristle_contact dither"),
        "blocks": ("Blocks, sliders and closed forms", "belt sliders bar torsional_pendulum damper oscillators closed_forms"),
        "brakes": ("Brakes and disks", "disc_brake brake_actuator shoe_brake band_brake squeal disks disk_stack"),
        "mechanisms": ("Mechanisms", "axis cranks gears gear_stage backlash overrunning_drive hand_arm"),
        "hydraulics": ("Flow and valves", "flow_line valve_spool"),
        "elastic": ("Elastic bodies", "elastic"),
    },
    "controllers": {
        "top_drive": (
            "Controllers of a top drive, and PID control of any signal",
            "pi pid soft_torque z_torque active_damping held_speed pipe",
        ),
        "state_feedback": ("Optimal and robust control", "lqr lqg h_infinity"),
        "sliding_modes": ("Sliding modes", "sliding_mode implicit_sliding_mode super_twisting"),
        "predictive": ("Predictive control", "linear_mpc nonlinear_mpc"),
        "brake_controllers": ("Controllers of a brake", "brake_law brake_force brake_mpc brake_pi brake_sliding_mode"),
        "dither": ("Dither", "dither"),
        "around": ("Controllers around others", "lifting on_estimates"),
        "observers": ("Observers", "observers"),
    },
}
"""{package: {page: (title, files or folders of the package whose public names stand on it)}}."""
SHELF_SAYS = "Numbers are SI, or text with a unit."
AUTHORS = {
    "toolbox.authoring": "What parts, laws and packages of your own build on, beside the names of `toolbox` itself. "
    "It changes only with a line in the changelog.",
}
_ENDS = r"(?=[.;] (?:Range|range|Defaults?|Assumed|Raises|Signals|Accuracy|Without|Sampled|Exact|Why|Where|The|A(?= [a-z])|It|With|Their|They)\b|$)"
_SOURCE = re.compile(r"\bSources?: (.+?)" + _ENDS)
_CITED = re.compile(r"((?:[A-Z]\. ?)+[A-Z][a-z][^:;]*?\(\d{4}\)(?: \d+(?:-\d+)?)?(?:, doi:10\.[^\s,;]+)?)")
_DOI = re.compile(r"doi:(10\.[^\s,;]+)")


def docstrings() -> Iterator[tuple[str, str]]:
    """(dotted name, paragraph in one line) of the docstrings of every module, class and function of the packages."""
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            module = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
            tree = ast.parse(path.read_text(encoding="utf-8"))
            for node in [tree, *ast.walk(tree)]:
                if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)) and not (
                    isinstance(node, ast.Module) and node is not tree
                ):
                    text = ast.get_docstring(node)
                    if text:
                        name = module if node is tree else f"{module}.{node.name}"  # type: ignore[union-attr]
                        yield from ((name, " ".join(paragraph.split())) for paragraph in re.split(r"\n\s*\n", text))


def cited() -> dict[str, list[str]]:
    """{dotted name: sources that its docstring cites}, textbooks without a name left out."""
    found: dict[str, list[str]] = {}
    for name, text in docstrings():
        spans = [match[1].rstrip(".; ") for match in _SOURCE.finditer(text)]
        spans += [match[1].rstrip(".;,") for match in _CITED.finditer(text) if not any(match[1].rstrip(".;,") in span for span in spans)]
        spans = [span for span in spans if not re.fullmatch(r"textbook|as `.*`", span) and "`{" not in span]
        if spans:
            found.setdefault(name, []).extend(span for span in spans if span not in found.get(name, []))
    return found


def sources_page() -> str:
    """The page of sources: publications with a DOI first, then what every part cites."""
    rows = cited()
    dois: dict[str, list[str]] = {}
    for name, spans in rows.items():
        for span in spans:
            for doi in _DOI.findall(span):
                dois.setdefault(doi.rstrip("."), []).append(name)
    lines = [
        "# Sources",
        "",
        "Made from the docstrings by `python docs/generate.py`. If a docstring names only the authors and the year of a source, the list does too.",
        "",
        "## With a DOI",
        "",
        "| DOI | cited by |",
        "|---|---|",
    ]
    lines += [
        f"| [{doi}](https://doi.org/{doi}) | {', '.join(f'`{name}`' for name in sorted(set(names)))} |"
        for doi, names in sorted(dois.items())
    ]
    lines += ["", "## By part", "", "| part | source |", "|---|---|"]
    lines += [f"| `{name}` | {span.replace('|', chr(92) + '|')} |" for name, spans in sorted(rows.items()) for span in spans]
    return "\n".join(lines) + "\n"


def reference_page(title: str, says: str, names: Sequence[str]) -> str:
    """A page of public names, given with the package or module from which they are imported, for mkdocstrings; parts and laws with a table of their fields."""
    lines = [f"# {title}", "", says, ""]
    for dotted in names:
        package, _, name = dotted.rpartition(".")
        thing = getattr(importlib.import_module(package), name)
        table = field_table(thing)
        lines += [f"::: {dotted}"]
        if table:
            lines += ["    options:", "      show_signature: false", "      members: false", "", *table, ""]
            for member in _own_methods(thing):
                lines += [f"::: {dotted}.{member}", "    options:", "      heading_level: 3", ""]
        else:
            lines.append("")
    return "\n".join(lines)


def public_of(place: str) -> list[str]:
    """The public names of a package or module, each as one imports it, functions first."""
    module = importlib.import_module(place)
    names = importlib.import_module("toolbox.faces").public_names(module)
    return [f"{place}.{name}" for name in sorted(names, key=lambda name: (inspect.isclass(getattr(module, name)), name.lower()))]


def names_of_rooms() -> dict[str, list[str]]:
    """{room: its public names, each as one imports it}: those of `toolbox` itself, then those of public modules, then the room's own."""
    toolbox = importlib.import_module("toolbox")
    stub = ast.parse(Path(toolbox.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    homes = {alias.name: f"{node.module or alias.name}".split(".")[0] for node in stub.body for alias in node.names}  # type: ignore[attr-defined]
    found: dict[str, list[str]] = {}
    modules = {}
    for dotted in (*public_of("toolbox"), "toolbox.time"):
        name = dotted.partition(".")[2]
        room = homes[name]
        if inspect.ismodule(getattr(toolbox, name)):
            modules[dotted] = room
        else:
            found.setdefault(room, []).append(dotted)
    rooms = {f"toolbox.{room.name}": room.name for room in iter_modules(toolbox.__path__) if room.ispkg and room.name != "authoring"}
    on_face = [getattr(toolbox, name) for name in homes]
    for place, room in {**modules, **rooms}.items():
        module = importlib.import_module(place)
        found.setdefault(room, []).extend(each for each in public_of(place) if getattr(module, each.rpartition(".")[2]) not in on_face)
    return found


def names_of_shelf(package: str) -> dict[str, list[str]]:
    """{page: public names of `models` or `controllers` on it}, by the file in which each is written. Raises KeyError for a file without a page."""
    page_of = {file: page for page, (_, files) in SHELVES[package].items() for file in files.split()}
    found: dict[str, list[str]] = {page: [] for page in SHELVES[package]}
    module = importlib.import_module(package)
    for dotted in sorted(public_of(package), key=str.lower):
        thing = getattr(module, dotted.rpartition(".")[2])
        home = (thing.__name__ if inspect.ismodule(thing) else thing.__module__).split(".")[1]
        found[page_of[home]].append(dotted)
    return found


def index_page(pages: Mapping[str, tuple[str, str]]) -> str:
    """The first page of the reference: {page: (title, contents)} as a table."""
    lines = [
        "# Reference",
        "",
        "Public functions and classes by subject. The search box finds a name.",
        "",
        "| page | contents |",
        "|---|---|",
    ]
    return "\n".join([*lines, *(f"| [{title}]({page}.md) | {says} |" for page, (title, says) in pages.items()), ""])


def scene_page() -> str:
    """The page of the keys of a scene file."""
    keys = importlib.import_module("toolbox.scenes.keys")
    lines = [
        "# Keys of a scene file",
        "",
        "Numbers are SI, or text with a unit. `stickslip list scene` prints this page on a terminal.",
        "",
    ]
    for table, entries in keys.KEYS.items():
        heading = "At the head of the file" if table == "scene" else f"`{table}`" if table.startswith("[") else table
        lines += [f"## {heading}", "", "| key | unit | without it | meaning |", "|---|---|---|---|"]
        lines += [f"| `{key.name}` | {key.unit} | {key.default} | {key.meaning} |" for key in entries]
        lines.append("")
    return "\n".join(lines)


def _own_methods(thing: type) -> list[str]:
    """Public methods and properties that a class documents, in the order of its source."""
    found = ((name, getattr(member, "fget", None) or getattr(member, "__func__", member)) for name, member in vars(thing).items())
    return [name for name, function in found if inspect.isfunction(function) and function.__doc__ and not name.startswith("_")]


def field_table(thing: Any) -> list[str]:
    """The fields of a part, a law or a friction law that are declared with `quantity`, and the others, as a table; empty for anything else."""
    from toolbox.contacts.problem import ContactBody
    from toolbox.modelling.components import Component
    from toolbox.modelling.elements import FrictionLaw

    if not (isinstance(thing, type) and issubclass(thing, (Component, ContactBody, FrictionLaw)) and dataclasses.is_dataclass(thing)):
        return []
    fields = [field for field in dataclasses.fields(thing) if field.name != "name" and not field.name.startswith("_")]
    if not any("unit" in field.metadata for field in fields):
        return []
    heads = ["field", "default", "unit", "bounds", "usual", "meaning"]
    heads += ["source of the default"] if any(field.metadata.get("source") for field in fields) else []
    rows = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    for field in fields:
        unit, words = field.metadata.get("unit", ""), [field.metadata.get(key, "") for key in ("meaning", "source")]
        cells = [
            f"`{field.name}`",
            _default(field),
            "" if unit == "1" else unit,
            _bounds(field.metadata),
            _usual(field.metadata.get("usual")),
            *words,
        ]
        rows.append("| " + " | ".join(cell.replace("|", chr(92) + "|") for cell in cells[: len(heads)]) + " |")
    return rows


def _default(field: dataclasses.Field[Any]) -> str:
    if field.default_factory is not dataclasses.MISSING:
        return _said(field.default_factory())
    return "needed" if field.default is dataclasses.MISSING else _said(field.default)


def _said(value: Any) -> str:
    if value is None:
        return "none"
    if isinstance(value, float):
        return f"{value:.7g}"
    if isinstance(value, tuple):
        return ", ".join(map(_said, value)) or "empty"
    text = repr(value) if not isinstance(value, str) else value
    return f"`{text}`" if len(text) <= 60 else f"`{type(value).__name__}`"


def _bounds(metadata: Mapping[str, Any]) -> str:
    words = (("at_least", ">="), ("above", ">"), ("at_most", "<="))
    return (
        ", ".join(f"{sign} {metadata[key]:g}" for key, sign in words if metadata.get(key) is not None)
        .replace(">", "&gt;")
        .replace("<", "&lt;")
    )


def _usual(usual: tuple[float, float] | None) -> str:
    if usual is None:
        return ""
    low, high = usual
    return f"{low:g} to {high:g}" if high < float("inf") else f"from {low:g}"


GROUPS = ("nominal", "noisy", "one_at_a_time", "combined", "other_rocks", "varying_weight")
"""Groups of machines in the order of the drive table."""
ANSWERS = (
    "stiff PI",
    "soft torque",
    "soft torque, tuned",
    "impedance, tuned",
    "H-infinity, tuned",
    "impedance, tuned, lifting",
    "LQG, between, lifting",
)
"""Rows of the answer on top of the drive table."""


def drive_page() -> str:
    """The page of the drive table: the text of `drive_table.md.in` with the tables of `drives.csv`, which `python -m studies drives --out docs` writes."""
    with (FOLDER / "drives.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    heads = ["controller", *GROUPS, "disk margin", "recovery time", "max bit speed", "tuned with"]
    lines, last = [], ""
    for row in sorted(rows, key=lambda row: DRIVE_KINDS.index(_drive_kind(row))):
        if (kind := _drive_kind(row)) != last:
            lines += [*([""] if last else []), f"### {kind}", "", f"| {' | '.join(heads)} |", "|" + "---|" * len(heads)]
            last = kind
        pairs = [_both_units(row, name) for name in GROUPS]
        margins = f"{_cell(row, 'disk margin', '.2f', '-')} / {_cell(row, 'disk margin, one_at_a_time', '.2f', '-')}"
        tried = f"{row['points tuned']} points" if row["points tuned"] != "0" else "as delivered"
        shorter = f" ({row['judged']})" if "half an hour" not in row["judged"] else ""
        price = [_cell(row, "recovery", ".0f", "-", " s"), _cell(row, "fastest", ".1f", "-", " x"), tried]
        lines.append(f"| {row['label']}{shorter} | {' | '.join([*pairs, margins, *price])} |")
    tables = {"answer": _answer_lines(rows), "drives": lines, "wells": _well_lines()}
    text = (FOLDER / "drive_table.md.in").read_text(encoding="utf-8")
    return text.format(**{name: "\n".join(each) for name, each in tables.items()})


def _answer_lines(rows: Sequence[Mapping[str, str]]) -> list[str]:
    """The short table on top: some drives on three groups of plants, protocol `takeover`."""
    groups = {"nominal": "nominal plant", "one_at_a_time": "one parameter wrong by 10 or 20 %", "varying_weight": "varying weight"}
    lines = [f"| controller | {' | '.join(groups.values())} |", "|---|" + "---|" * len(groups)]
    found = {row["label"]: row for row in rows}
    for label in ANSWERS:
        speeds = [float(found[label][f"{name} takeover"]) for name in groups]
        lines.append(f"| {label} | {' | '.join(f'{_rpm(speed)} rpm ({speed:.1f} rad/s)' for speed in speeds)} |")
    return lines


def _rpm(speed: float) -> str:
    return f"{speed * 30 / math.pi:.0f}"


def _both_units(row: Mapping[str, str], group: str) -> str:
    """The set-points of both protocols in rpm, and below in rad/s; empty where there are none yet."""
    names = [f"{group} {protocol}" for protocol in ("takeover", "ramp")]
    if not any(row.get(name) for name in names):
        return ""
    rpm = ("" if not row.get(name) else "none" if row[name] == "nan" else _rpm(float(row[name])) for name in names)
    told = " / ".join(rpm)
    return told if told == "none / none" else f"{told} rpm<br>{' / '.join(_cell(row, name) for name in names)}"


DRIVE_KINDS = ("As delivered", "Tuned", "With a lift of the set-point")
"""The parts of the drive table."""


def _drive_kind(row: Mapping[str, str]) -> str:
    return DRIVE_KINDS[2 if "lifting" in row["label"] else 0 if row["points tuned"] == "0" else 1]


def _well_lines() -> list[str]:
    """The table of wells, from `docs/wells.csv`, which `python -m studies wells --out docs` writes."""
    with (FOLDER / "wells.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    heads = [
        "well",
        "controller",
        "nominal",
        "one_at_a_time",
        "disk margin",
        "recovery time",
        "max bit speed",
        "first failure 0.1 rad/s lower",
    ]
    lines = [f"| {' | '.join(heads)} |", "|" + "---|" * len(heads)]
    for row in rows:
        pairs = [f"{_cell(row, f'{name} takeover')} / {_cell(row, f'{name} ramp')}" for name in ("nominal", "one_at_a_time")]
        margins = f"{_cell(row, 'disk margin', '.2f')} / {_cell(row, 'disk margin, one_at_a_time', '.2f')}"
        price = f"{_cell(row, 'recovery', '.0f')} / {_cell(row, 'recovery, one_at_a_time', '.0f')} s"
        cells = [
            row["well"],
            row["label"],
            *pairs,
            margins,
            price,
            _cell(row, "fastest, one_at_a_time", ".1f", unit=" x"),
            row["below, one_at_a_time"],
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def _cell(row: Mapping[str, str], name: str, form: str = ".1f", none: str = "none", unit: str = "") -> str:
    """A number of the csv; empty where there is none yet."""
    text = row.get(name, "")
    return "" if text == "" else none if text == "nan" else f"{float(text):{form}}{unit}"


def pages() -> dict[Path, str]:
    """{path: text} of every generated page."""
    folder = FOLDER / "reference"
    rooms = names_of_rooms()
    listed = [name for names in rooms.values() for name in names]
    apart = [word for _, _, words in THEMES.values() for word in words.split() if word.startswith("toolbox.")]

    def of(word: str) -> list[str]:
        """Names of a module that has a page of its own, or of a room without those."""
        if word in apart:
            return [name for name in listed if name.rpartition(".")[0] == word]
        return [name for name in rooms.get(word, []) if name.rpartition(".")[0] not in apart]

    told = {page: (title, says) for page, (title, says, _) in THEMES.items()}
    references = {
        page: (title, says, [name for word in words.split() for name in of(word)]) for page, (title, says, words) in THEMES.items()
    }
    for package, shelf in SHELVES.items():
        for page, names in names_of_shelf(package).items():
            words = ", ".join(f"`{name.rpartition('.')[2]}`" for name in names)
            told[page] = (shelf[page][0], words)
            references[page] = (shelf[page][0], SHELF_SAYS, names)
    for name, says in AUTHORS.items():
        told[name.rpartition(".")[2]] = ("For authors of packages", "Checks, tables, compiled helpers.")
        references[name.rpartition(".")[2]] = (name, says, sorted(public_of(name), key=str.lower))
    written = {folder / f"{page}.md": reference_page(*words) for page, words in references.items()}
    drives = {FOLDER / "concepts" / "drive_table.md": drive_page()}
    told["scene"] = ("Keys of a scene file", "All keys with unit, default and meaning.")
    return {
        FOLDER / "sources.md": sources_page(),
        folder / "scene.md": scene_page(),
        folder / "index.md": index_page(told),
        **drives,
        **written,
    }


def main() -> None:
    """Write the pages."""
    for path, text in pages().items():
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    main()
