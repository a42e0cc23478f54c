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
        "boreholes": ("Boreholes, torque and drag", "survey torque_and_drag wall_friction lateral"),
        "bits": ("Bits and rocks", "bit_rock smooth_bit_rock hysteretic_bit_rock drag_bit elastic_rock"),
        "friction": ("Friction laws", "friction bristles rate_and_state bristle_contact dither"),
        "blocks": ("Blocks, sliders and closed forms", "belt sliders bar torsional_pendulum damper oscillators closed_forms"),
        "brakes": ("Brakes and disks", "disc_brake shoe_brake squeal disks disk_stack"),
        "mechanisms": ("Mechanisms", "cranks gears gear_stage backlash overrunning_drive hand_arm"),
        "hydraulics": ("Flow and valves", "flow_line valve_spool"),
        "elastic": ("Elastic bodies", "elastic"),
    },
    "controllers": {
        "top_drive": ("Controllers of a top drive", "pi soft_torque z_torque active_damping held_speed pipe"),
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
        "Made from the docstrings by `python docs/generate.py`. A source that is only named by authors and year is cited so where it is used.",
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
DRIVES = """# The drive table

How slowly may a top drive turn before stick-slip comes back? The rig is the drill string of Jansen and van den Steen under a weight on bit of 97.3
kN. The string is in stick-slip, and a drive takes over. The table gives the lowest set-point at which the drive ends the stick-slip, and keeps it
ended for half an hour.

"""
DRIVES_RULES = """
A drive that raises its set-point while the bit sticks (`Lifting`) holds half the speed of soft torque or less on the nominal plant, and
hardly more with one error
of the plant, except H-infinity. With a varying weight its advantage is a quarter. The price is a recovery of about half a minute, in which
the bit turns at four to
five times the set-point.

![Lowest set-points of 26 drives: nominal plant, one error, three errors; bit speed after a takeover at 40 rpm](../figures/drives.png)

## All drives

Each cell has two numbers for the protocols `takeover` / `ramp`, in rpm and below in rad/s. In `takeover` the drive takes over at the set-point. In
`ramp` the set-point is raised during the takeover and lowered again. Drives measure the top speed only, are sampled every 10 ms, and their commands
come 30 ms late. The page on robustness describes the [groups of plants](robustness.md#the-lowest-set-point).

- `none`: no set-point holds. If 14 rad/s fails, lower set-points are tried in steps of 1 rad/s, so that a window wider than 1 rad/s is found.
- Disk margin: of the nominal plant at its takeover set-point / of the worst plant of `one_at_a_time` at the set-point of this group. `-` for a
  controller without a slope.
- Recovery: time with the top speed more than 10 % above the set-point, and highest speed of the bit as a multiple of the set-point. Both on the
  nominal plant, protocol `takeover`.
- Tuned with: number of points that a search of the gains tried (`python -m studies drives --tune FAMILY --runs N`). The searches of `impedance` and
  LQG, with and without a lift, and of `H-infinity` and `Z-torque` without a lift used constant weight only. The other searches also used a varying
  weight. For H-infinity 60 more points with both found nothing better. For Z-torque 120 more points found no gains with fewer failed runs.
- Predictive controllers are hundreds of times slower. The tuned linear one and the nonlinear one were therefore judged by fewer runs, which their
  rows state, and by one time series of each kind of weight. All others were judged with all phases and seeds, and for half an hour.
- The rows with dither of the weight need drawworks that no rig has ([below](#dither-of-the-weight)).

"""
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
AFTER = """
As csv: [drives.csv](../drives.csv). `python -m studies drives --out FOLDER` computes the rows, of all drives or of some (`--only`).

## With other time series of the weight

The group `varying_weight` tries ten time series of each kind of weight from two phases. `python -m studies confirmation --groups varying_weight`
repeats the group by a simulation in C with ten other time series, phases and noise, 80 runs a cell. The list gives the number of failed runs at the
printed set-points, takeover / ramp. All of them fail with the noise of 5 %:

- 0 / 1 for soft torque, 0 / 6 for `impedance, tuned`, 0 / 7 for PI, 0 / 8 for `soft torque, tuned`;
- 1 / 1 for `sliding mode, tuned`, LQR, both sliding modes with a lift and `soft torque, tuned, lifting`, 1 / 2 for `Z-torque, tuned`;
- 2 / 2 for `implicit sliding mode, tuned`, `super-twisting, tuned` and H-infinity;
- 3 / 3 for `LQG, tuned` and the dither of the weight, 4 / 3 for `LQG, between, lifting`, 5 / 5 for `Z-torque, tuned, lifting`, 5 / 6 for `LQG, tuned,
  lifting`;
- 6 / 5 for the dither of the weight with a lift, 6 / 6 for super-twisting with a lift, 6 / 7 for `impedance, tuned, lifting`.

The largest excursion of a time series decides, and another ten series hold a larger one. A set-point for random weight is therefore valid for the
time series that were tried; it is not a set-point that never sticks.

On the groups `nominal`, `noisy`, `one_at_a_time`, `combined` and `other_rocks` the simulation in C confirms the borders of `impedance, tuned` and
`LQG, tuned, lifting` to the digit, except 2 of 72 runs of the first on `combined`, takeover. It also confirms PI, LQR, active damping, `Z-torque,
tuned`, the tuned sliding modes, the sliding modes with a lift, soft torque and dither of the weight with a lift, and the two super-twisting
controllers with a lift. Exceptions:

- of `soft torque, tuned` 1 of 8, 9 of 160 and 3 of 264 runs fail on `nominal`, `noisy` and `one_at_a_time`, takeover; with a lift 1 of 160 fails on
  `noisy`. None fails 0.1 rad/s higher;
- of H-infinity with a lift 2 of 160 runs fail on `noisy` and 1 of 264 on `one_at_a_time`, takeover;
- with other time series of the weight 6 / 6 of 80 runs of super-twisting on an impedance with a lift fail at 5.8 rad/s, all with the noise of 5 %.

## One law

`LQG, between, lifting` is LQG inside `Lifting`. Its gains lie a quarter of the way, in logarithms, from the gains tuned without a lift to the gains
tuned with a lift. Of five places on this way it is the place with the largest margin for the worst plant of any group (`studies.gains.margins_at`,
seconds each). In the row "margin 0.05" its set-points are raised in steps of 0.1 rad/s until every plant of the group has a disk margin of 0.05
(`--margin 0.05`). With the protocol `takeover` the worst plant then has:

| group | set-point [rad/s] | disk margin |
|---|---|---|
| nominal | 3.1 | 0.062 |
| noisy | 3.3 | 0.085 |
| one_at_a_time | 3.7 | 0.080 |
| combined | 4.0 | 0.088 |
| other_rocks | 5.2 | 0.070 |
| varying_weight | 6.0 | 0.454 |

One step lower the margin may be small: 0.003 at 2.9 rad/s, the lowest set-point on the nominal plant. `python -m studies confirmation` finds the same
borders on `nominal`, `noisy`, `one_at_a_time`, `combined` and `other_rocks` by an independent simulation with other noise. The command reads its
set-points from this table and repeats every row except the predictive controllers. Gains on either side are worse: the gains tuned without a lift
leave 0.033 on `one_at_a_time`, and the gains tuned with a lift are unstable at 5.4 rad/s on other rocks. Z-torque on the same way leaves 0.021 at
best for its worst plant, because low set-points on the nominal plant need other gains than on `one_at_a_time`. Every lift has a price. At the border
on the nominal plant the top turns for 27 s at more than 1.1 times the set-point, and the bit reaches 3.75 times the set-point. On the plants of the
other groups, at their borders with `takeover`, the price is up to 62 s and 5.2 times.

The next table gives the price at 4 / 6 rad/s on the nominal plant, each number the worst of its runs (`python -m studies recovery --only "LQG,
between"`; flags and fractions with `--below 1.5 2 2.2 2.4 2.6 2.7 2.8 2.85`). The row "margin 0.05" is the same controller at higher set-points:

| what happens | what is measured | found | wanted at most |
|---|---|---|---|
| taken over in stick-slip, eight phases | highest top speed, in parts of what is asked | 1.96 / 1.75 | 2 |
| | last stick after | 14 / 5 s | 20 s |
| | at the set-point after | 40 / 14 s | 60 s |
| the set-point is doubled | highest top speed, in parts of the new one | 1.02 | 1.12 |
| and halved again | stick | none | none |
| set-points below its border: 1.5, 2.0, 2.2, 2.4, 2.6, 2.7, 2.8 rad/s | flag after | 55, 227, 201, 197, 207, 263, 392 s | 400 s |
| | share of half an hour that is lifted | at most 5.5 % | 15 % |
| the weight goes up by 1.3 / 1.5 at 6 rad/s | last stick after | 5 / 42 s | it holds |
| the bit is held for a minute | highest top speed from 15 s after, in parts of what is asked | 1.89 | 2 |

All of it is as wanted. At 2.8 rad/s steady drilling is hardly unstable, so that the flag comes late; nearer to the border it takes longer still: at
2.85 rad/s 631 s.

The set-point is raised to 1.6 times its value, at 0.3 rad/s2. While the top turns faster than 1.7 times the set-point and faster than 6.8 rad/s, the
torque is lowered (`speed_limit_factor`, `min_speed_limit`). Without this limit, a lift to twice the set-point at 0.5 rad/s2 gives a top speed of 2.46
times the set-point: the inner controller follows the released bit, and even without a lift the top reaches 2.26 times the set-point. A smaller lift
alone gives 2.38 (`first_factor` 1.3 or 1.5). The price of the limit is a longer oscillation: at 4 rad/s the last stick comes 14 s after the takeover
instead of 10 s, and after a stall the top turns at 1.89 times the set-point instead of 1.11 times. For weaker controllers the limit costs more than
it gains: with a limit of 1.75 and a first lift of 1.5, soft torque and the tuned impedance stick for 38 and 28 s.

The limit has a minimum (`min_speed_limit`), because a released bit turns equally fast at low and high set-points, and a top that follows the bit
calms it. The table compares runs without / with the minimum of 6.8 rad/s, from eight phases. With 6.4 rad/s the bit is released once more at 3.6
rad/s, and with 7.3 rad/s the top reaches 2.06 times the set-point at 4 rad/s:

| set-point [rad/s] | highest top, in parts of it | last stick after | at the set-point after | highest speed of the bit, in parts of it |
|---|---|---|---|---|
| 2.9 | 3.13 / 2.69 | 43 / 18 s | 87 / 48 s | 5.2 / 4.5 |
| 3.6 | 2.38 / 2.17 | 25 / 12 s | 58 / 38 s | 4.2 / 3.9 |
| 3.8 | 2.32 / 2.07 | 18 / 11 s | 51 / 37 s | 4.1 / 3.7 |
| 4.0 | 1.96 / 1.96 | 14 / 14 s | 40 / 40 s | 3.6 / 3.6 |

## Comparison with the inner controller

Is a controller with a lift ever worse than its inner controller? The inner controllers of `LQG, between`, `LQG, tuned`, `Z-torque, tuned` and
`impedance, tuned` were run alone with the same gains, 0.2 rad/s below the set-points of their rows with a lift, on all six groups, with both
protocols. In 47 of the 48 cells some run fails within the judged window. In one cell (`LQG, tuned`, other rocks, ramp, 6.0 rad/s) smooth running is
unstable and does not last, with or without the lift. So none of these rows is worse than its inner controller by more than 0.1 rad/s on any group.
`python -m studies recovery --inside GROUP ...` finds the borders of both.

## Below the lowest set-point

After how long does a controller with a lift give up, from inside stick-slip on the nominal plant, and for which fraction of half an hour is its set-point
raised (`python -m studies recovery --below SPEED ...`)? The aim is a flag after at most 400 s, and at most 15 % of the time.

| law inside | flag after, at set-points [rad/s] | holds from | lifted at most |
|---|---|---|---|
| soft torque, as delivered | 62 s at 1.5, 74 at 2, 155 at 2.5, 170 at 3, 170 at 3.5, 264 at 3.7 | 3.8 | 7.9 % |
| PI, as delivered | 71 s at 1.5, 65 at 2, 177 at 2.5, 168 at 3, 190 at 3.5, 214 at 3.8, 302 at 3.9 | 4.0 | 8.8 % |
| impedance, tuned | 43 s at 1.5, 132 at 2, 134 at 2.5, 126 at 3, 131 at 3.3, 165 at 3.4 | 3.5 | 6.8 % |
| Z-torque, tuned | 194 s at 1.5, 102 at 2, 86 at 2.5, 120 at 3, 201 at 3.3, 266 at 3.35, 547 at 3.4 | 3.5 | 10.7 % |
| LQG, tuned | 219 s at 1.5, 179 at 2, 165 at 2.5, 182 at 2.7, 250 at 2.8 | 2.9 | 6.8 % |
| LQG, between | 55 s at 1.5, 227 at 2, 197 at 2.4, 263 at 2.7, 392 at 2.8, 631 at 2.85 | 2.9 | 5.5 % |
| H-infinity, tuned | 245 s at 1.5, 50 at 2, 167 at 2.5, 100 at 3, 109 at 3.2 | 3.4 | 4.7 % |

The sliding modes, super-twisting, `soft torque, tuned` and the dithered weight give up after 68 to 213 s at 1.5, 2, 2.8, 3.2 and 3.4 rad/s, where
they do not hold, but for `soft torque, tuned` at 3.4, after 313 s; they are lifted 12.2 % of the time at most.

Within 0.1 rad/s of the border the flag may come later than the aim, because steady drilling is hardly unstable there, and each stick comes minutes
after the last one. H-infinity at 1.5 rad/s does not work at all: the bit stands still and the torque ends at zero. A lift cannot end this standstill,
but the flag reports it. If weight is also taken off, `LQG, between` swings at 1.5 and 1.6 rad/s without a stick; a lift without success ends after
206 s (11 % of the time).

## Dither of the weight

Dither of the weight, phased with an estimate of the bit speed, reaches lower set-points than control of the torque alone, without a lift: 1.7 rad/s
on the nominal plant and 2.3 rad/s on `one_at_a_time`, with a disk margin of 0.07 and 0.16. None of the 124 runs of the search of its gains fails: 112
on plants with errors, down to 4 rad/s, and 12 with a varying weight, at 6 and 8 rad/s. The independent simulation confirms the set-points to the
digit on `nominal`, `noisy`, `one_at_a_time` and on other rocks, and on `combined` within 0.1 (one run of 72 sticks at 2.3 rad/s). With a varying
weight 3 of 80 runs with other time series stick at 3.4 rad/s, all with the noise of 5 %, and none of 80 at 3.8 rad/s.

**Its price is drawworks that no rig has.** In the table the weight at the bit follows its command with a delay of 30 ms and at any rate. In smooth
running without noise the weight then hardly moves (0.004 %). With noise of 0.01 rad/s of the measured speed the estimate moves the weight over its
whole range of 40 %, at up to 32 times the weight a second. A wave takes 0.4 s along 2 km of steel, and a fifth of this weight is some 6 cm of
hoisting on a pipe of 5 in. With slower drawworks the lowest set-points of the protocol `takeover` are, in steps of 0.5 rad/s above the set-points of
the table (`python -m studies confirmation --hoist LATE RATE`):

| drawworks | nominal | one_at_a_time |
|---|---|---|
| as in the table | 1.7 | 2.3 |
| 100 % of the weight a second | 1.7 | 3.3 |
| 50 % a second | 2.2 | 3.3 |
| 20 % a second | 6.2 | 7.3 |
| 0.4 s later, any rate | 3.7 | 4.3 |
| 0.4 s later, 50 % a second | 4.7 | 6.8 |

With the travel time of the wave dither has no advantage over `LQG, between, lifting`, which needs no drawworks.

## Strategies by name

- *Stiff PI*, as drives are delivered, ends a stick-slip only from 12.5 rad/s (119 rpm) on, above which none exists; where the set-point is raised
  first, it holds 4.4 rad/s on the nominal rig and on `combined`, and no less than 12.5 with more weight, on other rocks or under a weight that
  varies.
- *PI* as delivered is softer and keeps the largest margin of all, 1.7, which says nothing about a stick-slip that exists: that ends at 9.6 to 12
  rad/s.
- *Active damping* makes the drive an absorber of the bit, by a formula of the nominal rig: without a search of gains it holds less than soft torque
  on four of the six groups in the protocol `takeover` (`one_at_a_time` and `combined` among them), and on five in `ramp`, with a disk margin of 0.7.
- *Soft torque* (Jansen and van den Steen) gives way like the string's own impedance at its lowest frequency: it keeps a large margin, and ends a
  stick-slip only where that hardly lives, unless the set-point is raised for it. With its one number searched, a drive 1.73 times as soft, it holds a
  quarter lower on the rigs `nominal` and `one_at_a_time` in the protocol `takeover`, and no lower when the set-point is raised.
- *Impedance* is the same drive with two gains that are searched: lower by a fifth to two fifths when it takes over directly, with the largest margins
  of all.
- *Z-torque* (Aarsnes, Di Meglio and Shor) absorbs the waves of the pipe over all frequencies, within what the inertia of the drive allows. As
  delivered it takes nearly all of that inertia away: low on the nominal rig, but under noise the torque ripples by 7 to 10 %, and on a drive that is
  20 % lighter than it believes it swings between its limits. Tuned it holds all groups.
- *Sliding modes* (Navarro-Lopez and Cortes; implicit: Acary and Brogliato), as delivered, are not stable on a drive that is 20 % lighter than they
  believe: the torque swings between 0 and 20 kN m for ever, and the mean speed is 10 to 45 % too low, at any set-point, so that `one_at_a_time` and
  `combined` have `none`. With gains that are searched they hold every group; the implicit one alone leaves a swing on that drive which grows in 750
  s. As delivered it answers the noise of the measured speed with a torque that ripples by 6 to 7 %, where at most 5 % count as smooth. Lifted it
  needs 3.8 rad/s on `one_at_a_time`.
- *Super-twisting* (Levant) is a continuous sliding mode, and holds what that holds; on the error of an impedance it holds the nominal rig from 3.8
  rad/s on. Lifted that is the lowest law of the torque on `one_at_a_time` and `combined`, at 3.4 and 3.7 rad/s. Its slope at zero has no end, so that
  no disk margin is told; its half hours are run, not read from a matrix.
- *LQR* with the estimates of a Kalman filter, as delivered, is low on the nominal rig and not stable on that light drive either (mean speed 6 to 12 %
  too low); with gains that are searched the same filter and feedback are LQG.
- *H-infinity* (Doyle, Glover, Khargonekar and Francis) makes the worst amplification of disturbances and noise small: good on the nominal rig, but
  three errors at once take it to more than twice its set-point.
- *LQG* (Kalman's filter and feedback of its states) reaches lowest of the laws that neither plan nor lift on the nominal rig, and keeps next to no
  margin there.
- *Lifting* (drillers' practice of more speed against stick-slip) makes nearly every law inside it robust, at the price above; H-infinity gains least.
- *Linear predictive control* (Rawlings, Mayne and Diehl) plans 4 s on a linear string: of all laws of the torque that are judged for half an hour it
  is the lowest on the nominal rig, and about where H-infinity is on others.
- *Nonlinear predictive control* (Diehl, Bock and Schlöder) plans through stick and slip, and reaches lowest of all laws of the torque on the nominal
  rig where the set-point is raised, judged for 80 s only. Under a weight that varies nothing holds that was tried: at 6 rad/s it sticks under the
  noise of 5 %, and taken over directly at 7 to 14 rad/s its torque is at a limit for 1.4 to 2.8 % of the time under the heave of 10 %, where at most
  1 % count as smooth.
- *Dither of the weight*: above.

Not in the table, because there is no such law in the toolbox: drives designed by a skewed structured singular value (Vromen), laws on the wave equation
(Bresch-Pietri and Krstic), drives that tune themselves from surface data (Auriol, Aarsnes and Shor), and damping tools above the bit. Gains by length of
the string are a [schedule](tuning.md#gains-over-depth); brakes have [tables of their own](brakes_and_dither.md).
"""
WELLS = """
## On other wells

Do gains that were tuned on this rig serve others? `python -m studies wells` asks on wells of 1500, 3000 and 5000 m (drill pipe of 5 in on 200 m of
collars, nine inertias), each in a vertical hole and with dry friction along a hole of 30 degrees (4.9, 7.8 and 11.6 kN m before the string turns), and on
the four inertias of Navarro-Lopez and Cortes, all under the same bit and 97.3 kN, with a drive of 40 kN m. The gains are those of the tables above, in the
same parts of the string's own impedance `zeta` and lowest frequency `om` below a drive that does not turn: proportional ~ zeta, integral ~ J om^2 with the
inertia J of the drive, size of the angle ~ 1 / om, size of the torque ~ zeta, walk of the rock ~ zeta sqrt(om), walk of the drive ~ J. None was tuned on
its well.

Takeover / ramp, [rad/s], on the wells `nominal` and `one_at_a_time`, each the lowest at which every machine moreover leaves a disk margin of 0.05; disk
margin at the first, nominal / worst of `one_at_a_time`; recovery, nominal / `one_at_a_time`, and highest speed of the bit in parts of what is asked. Each
cell is judged as those of the table above are: all phases and seeds, and half an hour (`--full`; without it two phases and one seed for 80 s).

"""
WELLS_AFTER = """
The impedance, a law of two gains, holds 4.0 to 4.2 rad/s on every well of `one_at_a_time` and 3.8 on four inertias, without a search of gains. LQG holds
4.1 on every one of these and 3.5 on four inertias, but for one: taking over directly at 1500 m with friction it needs 5.0, because at 4.9 one run of 264,
with a drive 20 % heavier, has its last stick 62 s after the takeover, so that its top is lifted for 93 s, longer than the 80 s that it is given (none of
the 264 fails at 4.5). Friction along the hole changes hardly any other border, because at a set-point it is a constant torque.

What ends it 0.1 rad/s lower on a well of `one_at_a_time` is mostly not the recovery but smooth running: it is unstable on one machine there, or leaves a
disk margin of 0.02, where 0.09 to 0.58 are left at the printed set-point, because the friction of the rock falls more steeply at lower speeds. On four
inertias it is the recovery: with LQG the bit is still 15 % too fast five periods of the string after the takeover, and under the impedance it sticks from
the phase 0.75 up to 3.7 rad/s. The springs of that rig are damped forty times as much as those of the wells, and under the stiff drive its bit sticks up
to 5 rad/s only, that of the wells at 8, too. At 4.5 rad/s the gains of the impedance as they are on the rig of the first table hold 1500 m too, and fail
at 5000 m by a hair (2.1 % of the speed in place of 2, with 20 % more weight) and on four inertias (25 %); that was tried from two phases with one seed.

The price is higher than on the rig: the top is above what is asked for up to 77 s, and the bit reaches 3.0 to 5.7 times the set-point. As csv, with the gains
and with what fails 0.1 rad/s lower: [wells.csv](../wells.csv).
"""


def drive_page() -> str:
    """The whole drive table, from `docs/drives.csv`, which `python -m studies drives --out docs` writes."""
    with (FOLDER / "drives.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    heads = ["controller", *GROUPS, "disk margin", "recovery", "bit", "tuned with"]
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
    return (
        DRIVES
        + "\n".join(_answer_lines(rows))
        + "\n"
        + DRIVES_RULES
        + "\n".join(lines)
        + "\n"
        + AFTER
        + WELLS
        + "\n".join(_well_lines())
        + "\n"
        + WELLS_AFTER
    )


def _answer_lines(rows: Sequence[Mapping[str, str]]) -> list[str]:
    """The short table on top: some drives on three groups of plants, protocol `takeover`."""
    groups = {"nominal": "nominal plant", "one_at_a_time": "one error of 10 or 20 %", "varying_weight": "varying weight"}
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


DRIVE_KINDS = ("As delivered", "Tuned", "Lifting their set-point")
"""The parts of the drive table."""


def _drive_kind(row: Mapping[str, str]) -> str:
    return DRIVE_KINDS[2 if "lifting" in row["label"] else 0 if row["points tuned"] == "0" else 1]


def _well_lines() -> list[str]:
    """The table of wells, from `docs/wells.csv`, which `python -m studies wells --out docs` writes."""
    with (FOLDER / "wells.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    heads = ["well", "law", "nominal", "one_at_a_time", "disk margin", "recovery", "bit", "what fails 0.1 lower, one_at_a_time, takeover"]
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
