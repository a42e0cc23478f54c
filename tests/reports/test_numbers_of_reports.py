"""Every number of a report is that of the csv, npz, toml or json beside it, at the digits shown; what stands in none of them is listed with its reason."""

import csv
import hashlib
import json
import math
import re
import tomllib

import numpy as np
import pytest

from tests.reports.test_report import SCENE as MARKED
from tests.reports.test_report import Page
from toolbox.commands.command_line import main
from toolbox.onsets.results import Onset
from toolbox.reports import report

SCENE = MARKED.replace(" <95 rpm>", "")  # a title without a number

COMMANDS = {
    "study": [],
    "onset": ["--range", "top.reference=80 rpm:150 rpm", "--values", "3"],
    "map": ["--controller", "stiff PI", "--range", "top.reference=60rpm:130rpm", "--range", "bit.weight=60kN:110kN", "--shape", "3x3"],
    "setpoints": ["--group", "nominal", "--range", "top.reference=60 rpm:140 rpm", "--step", "10 rpm"],
    "fit": ["LOG", "--range", "bit.friction.kinetic=0.3:0.7", "--range", "bit.friction.static=0.6:1"],
    "posterior": [
        "--controller", "stiff PI", "--prior", "bit.weight=50kN:110kN", "--measured", "severity=1.9 +- 0.1", "--draws", "32",
    ],
}  # fmt: skip
"""What is called for each report."""

NUMBER = r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[-+]?\d+)?"
FACTORS = {"rpm": math.pi / 30.0, "%": 0.01, "kN": 1000.0}
"""{unit that is printed behind a number: in SI}; the factor of all others is 1."""

UNIT = re.compile(rf"(?:(?: to |  ?\.\. ?| ?\.\. |, ){NUMBER})*\s{{0,2}}(kN|rpm|%)(?!\w)")
"""The unit that follows a number, or several of one unit."""

LISTED = {
    r"Figure \d+\. ": "figures are counted on the page",
    r"unknown +unit +mean +deviation +5 % +95 % +before$": "quantiles are named by a heading",
    r"Sources: Navarro-Lopez and Cortes \(2007\)\.$": "the year of what the numbers of the machine come from",
    r"Holds for: |This holds for ": "the situation stands in no table; `tests/robustness/test_starts.py` derives its numbers",
    r"Lowest set-points at which a controller ends the stick-slip under stiff PI \(60 to 140 rpm, steps of 10 rpm\)$": "what was asked for",
}
"""{lines: why their numbers stand in no file}."""

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """A folder of results of every command, about one machine, with a log of one of its runs."""
    folder = tmp_path_factory.mktemp("numbers")
    (folder / "rig.toml").write_text(SCENE)
    for command, given in COMMANDS.items():
        words = [str(folder / "log.csv") if word == "LOG" else word for word in given]
        assert main([command, str(folder / "rig.toml"), *words, "--quiet", "--out", str(folder / command)]) == 0
        if command == "study":
            with np.load(folder / "study" / "01_stiff_pi.npz") as run:
                units = {"top.speed": "rad/s", "top.torque": "N m", "bit.speed": "rad/s"}
                times = np.arange(0.0, 40.0, 0.1)
                logged = np.column_stack([times, *(np.interp(times, run["time"], run[name]) for name in units)])
            heads = ",".join(["time [s]", *(f"{name} [{unit}]" for name, unit in units.items())])
            np.savetxt(folder / "log.csv", logged, delimiter=",", header=heads, comments="")
    return folder


def rows_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def fields_of(path):
    """The numbers and texts of a result in an npz file, and its arrays."""
    with np.load(path) as data:
        arrays = {name: data[name] for name in data.files}
    told = json.loads(str(arrays["result"]))
    return told["fields"], arrays


def split(text):
    """(text of a number, factor of the unit behind it) of all numbers of a line."""
    found = []
    for each in re.finditer(NUMBER, text):
        unit = UNIT.match(text, each.end())
        found.append((each.group(), FACTORS[unit.group(1)] if unit else 1.0))
    return found


def equal(text, factor, value):
    """Whether the number of a text is a value at the digits shown."""
    mantissa, _, exponent = text.partition("e")
    last = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
    if not exponent and "." not in mantissa and len(mantissa.lstrip("-")) > 2 and mantissa.endswith("0"):
        last *= 10.0 ** (len(mantissa) - len(mantissa.rstrip("0")))  # 1230 may be four digits or three
    return abs(float(text) - value / factor) <= 0.5 * last * (1.0 + 1e-9) + 1e-12


def all_in(path):
    """{name: values} of the parameters of the plant of a scene."""
    found = {}

    def walk(name, value):
        if isinstance(value, dict):
            for key, inner in value.items():
                walk(f"{name}.{key}", inner)
        elif not isinstance(value, str):
            found[name] = value if isinstance(value, list) else [value]

    scene = tomllib.loads(path.read_text())
    for name, part in zip(("chain", "bit"), scene["plant"], strict=True):
        walk(name, part)
    return scene, found


def gains(path):
    """Proportional and integral gain of a PI law [N m s/rad, N m/rad], from the traces of its run."""
    with np.load(path) as run:
        reference = np.repeat(run["step.top.reference"], run["step.degree"] + 1)  # which changes in no step, and is kept once a step
        torque, error = run["step.top.torque"], reference - run["step.top.speed"]
        angle = next(run[name] for name in ("step.stiffpi.angle", "step.softtorque.angle") if name in run)
    return np.linalg.lstsq(np.column_stack([error, angle]), torque, rcond=None)[0]


def of_machine(results, folder):
    """Rules for the machine and the laws."""
    scene, numbers = all_in(folder / "scene.toml")
    rules = [(rf"{re.escape(name)}  ", values) for name, values in numbers.items()]
    rules += [(rf"{value:.4g} kg m", [value]) for value in numbers["chain.inertia"]]
    for i, (label, law) in enumerate((("stiff PI", "StiffPI"), ("soft torque", "SoftTorque")), 1):
        values = gains(results / "study" / f"{i:02d}_{label.lower().replace(' ', '_')}.npz")
        rules.append((f"{label}  {law}, ", [*values, scene["controllers"][i - 1]["reference"]]))
    return rules


def of_origin(folder):
    """Rules for where it comes from; its texts stand whole in `origin.json`."""
    origin = json.loads((folder / "origin.json").read_text())
    begun = origin["began"].replace("T", " ").replace("+00:00", " UTC")
    versions = ", ".join(f"{name} {version}" for name, version in origin["versions"].items())
    rules = [
        (re.escape(origin["command"]) + "$", None),
        (f"Versions: {re.escape(versions)}.$", None),
        (rf".*computed {re.escape(begun)}$", None),
        (rf"[\w -]+: {origin['seconds']:.3g} s, begun {re.escape(begun)}\.$", None),
        ("file  SHA-256$|folder  file  SHA-256$", None),
    ]
    hashes = {str(folder / name): f"{folder}  {name}" for name in origin["files"]} | {name: name for name in origin["inputs"]}
    for path, words in hashes.items():
        with open(path, "rb") as file:
            rules.append((f"{re.escape(words)}  {hashlib.file_digest(file, 'sha256').hexdigest()}$", None))
    return rules


def of_study(results):
    folder = results / "study"
    scene = tomllib.loads((folder / "scene.toml").read_text())
    rules = [(".* judged from ", [scene["verdict"]["after"], scene["duration"], scene["reference"]])]
    errors, free, sticking = [], [], []
    for row in rows_of(folder / "table.csv"):
        settled = [float(row["settling"]), float(row["overshoot"])] if row["settling"] != "inf" else []
        values = [float(row[name]) for name in ("stuck", "severity", "peak", "error")]
        rules.append((f"{row['controller']} +{row['verdict']} ", [*values[:2], *settled, *values[2:]]))
        price = [100.0 * settled[1], settled[0]] if settled else []  # the first page names percent and kN m in the heads of its columns
        rules.append((f"{row['controller']} +{row['verdict']} ", [*price, values[2] / 1000.0]))
        errors.append(values[3])
        (free if settled else sticking).append([*([settled[1]] if settled else []), values[2]])
        with np.load(folder / f"{row['files']}.npz") as run:  # and the table is that of the traces
            sampled = np.abs(run["step.top.torque"]).max()
            assert sampled <= values[2] * (1.0 + 1e-12) and values[2] == pytest.approx(
                sampled, rel=1e-4
            )  # the peak lies between two samples
            switches = zip(run["event.time"], run["event.before"], run["event.after"], strict=True)
            begins, stuck = scene["verdict"]["after"] if run["modes.word"][run["bit.mode"][0]] == "stick" else None, 0.0
            for time, before, after in switches:
                if before == "stick" and time > scene["verdict"]["after"]:
                    stuck += time - max(begins, scene["verdict"]["after"])
                if after == "stick":
                    begins = time
            assert values[0] == pytest.approx(stuck, abs=1e-9)
    (own,), (other,) = free, sticking  # the sentences of the first page
    rules.append(("Price: overshoot ", [*own, *other]))
    rules.append(("How sure: one run ", [max(errors)]))
    return folder, rules


def of_onset(results):
    folder, rules = results / "onset", []
    for i, label in enumerate(("stiff PI", "soft torque"), 1):
        stem = f"{i:02d}_{label.lower().replace(' ', '_')}"
        told, arrays = fields_of(folder / f"{stem}_onset.npz")
        values, at = arrays[told["values"]], told["at"]
        assert np.array_equal(values, [float(row["top.reference [rad/s]"]) for row in rows_of(folder / f"{stem}_onset.csv")])
        ends = [float(row["top.reference [rad/s]"]) for row in rows_of(folder / f"{stem}_borders.csv")]
        tolerances = [float(row["tolerance"]) for row in rows_of(folder / f"{stem}_borders.csv")]
        margins, rpm = [(at - end) / end for end in ends], 30.0 / math.pi
        bands = [value for end in ends for value in (values[0], end)]
        own = Onset.load(folder / f"{stem}_onset.npz")
        near = int(np.argmin(np.abs(values - at)))
        starts = sorted(own.reached, key=lambda each: not each.reached)  # those that reach stick-slip come first
        counted = [
            number
            for each in starts
            for number in (
                *([4.0] if "kick" in each.start else []),
                each.reached,
                each.runs,
                *([] if math.isnan(each.smallest) else [each.smallest]),
            )
        ]
        reach = [own.sticking[near].interval, *counted] if starts else []
        rules += [
            (rf"{label} +[-\d]", [*(rpm * each for each in [*ends, *bands, at]), *margins]),
            (f"The working point {at * rpm:g} rpm is {'bistable' if ends else 'free'}", [at, *reach, *margins]),
            (r"top\.reference from 80 to 150 rpm", [values[0], values[-1]]),
            (r"Note: Stick-slip was begun at|Stick-slip was begun at", [len(values)]),
            (
                rf"Checked: {told['runs']} runs",
                [
                    told["runs"], told["accuracy"], told["duration"], told["duration"] / told["period"], told["period"], told["perturbation"],
                ],
            ),
        ]  # fmt: skip
        for end, tolerance in zip(ends, tolerances, strict=True):
            rules += [("existing stick-slip ends +\\d", [end, rpm * tolerance]), ("bistable +\\d", [values[0], end])]
        for row in rows_of(folder / f"{stem}_onset.csv"):
            value = float(row["top.reference [rad/s]"])
            longest = [float(row["sticking longest"])] if float(row["sticking longest"]) else []
            cells = [
                rpm * value,
                float(row["smooth severity"]),
                -1.0 / float(row["smooth rate"]),
                float(row["sticking severity"]),
                *longest,
            ]
            rules.append((rf"{value * rpm:.5g}  ", cells))
    return folder, rules


def of_map(results):
    folder = results / "map" / "01_stiff_pi"
    told, arrays = fields_of(folder / "map.npz")
    axes, segments = [arrays[name] for name in told["axes"]], {name: arrays[key] for name, key in told["borders"]}
    rows = rows_of(folder / "map.csv")
    factors = {"top.reference [rpm]": math.pi / 30.0, "bit.weight [kN]": 1e3}
    x, y = (factor * np.array([float(row[name]) for row in rows]) for name, factor in factors.items())
    np.testing.assert_allclose(np.unique(x.round(12)), axes[0], rtol=1e-12)
    np.testing.assert_allclose(np.unique(y.round(6)), axes[1], rtol=1e-12)
    rules = [
        (r"top\.reference from", [x.min(), x.max(), axes[0].size]),
        (r"bit\.weight from", [y.min(), y.max(), axes[1].size]),
        (rf"{told['runs']} runs, each", [told["runs"], told["duration"], told["accuracy"]]),
    ]
    regions = [row["region"] for row in rows]
    rules += [(f"{name} +\\d", [regions.count(name) / len(regions)]) for name in set(regions)]
    borders = rows_of(folder / "borders.csv")
    for row in borders:  # the points, in the units of their headings
        cells = [float(value) for key, value in row.items() if key not in ("border", "line")]
        rules.append((re.escape(f"{cells[0]:.6g}"[:3]) + r"[\d.]*  ", cells))
    for name in {row["border"] for row in borders}:
        points = np.array([[factor * float(row[key]) for key, factor in factors.items()] for row in borders if row["border"] == name])
        np.testing.assert_allclose(points, np.vstack([segments["sticking"][:1, 0], segments["sticking"][:, 1]]), rtol=1e-12)
        low, high = points.min(axis=0), points.max(axis=0)
        rules.append((f"{name} +\\d", [low[0], high[0], low[1], high[1]]))
    return folder, rules


def of_drives(results):
    folder, rules = results / "setpoints", []
    for row in rows_of(folder / "setpoints.csv"):
        value = {
            key: float(text) for key, text in row.items() if text and key not in ("controller", "group", "protocol", "why", "weakest_plant")
        }
        rpm = 30.0 / math.pi
        cells = [
            rpm * value["lowest_set_point"],
            value["disk_margin"],
            value["disk_margin_nominal"],
            value["time_above_setpoint"],
            value["recovery_time"],
            rpm * value["max_bit_speed"],
        ]
        last = [-1.0 / value["growth_rate"], *(float(text) * factor for text, factor in split(row["why"]))]
        begin = f"{row['controller']}  {row['group']}  {row['protocol']} "
        rules += [
            (begin, [*cells, value["max_torque"], *last]),
            (begin, [cells[0], cells[1], cells[4], *last]),
        ]  # as printed, and those that answer
    return folder, rules


def of_fit(results):
    folder = results / "fit"
    told, arrays = fields_of(folder / "fit.npz")
    rows = {row["name"]: row for row in rows_of(folder / "fit.csv")}
    panels = {each["name"]: {key: arrays[each[key]] for key in ("x", "measured", "model")} for each in told["panels"]}
    log = np.genfromtxt(results / "log.csv", delimiter=",", names=True, deletechars="")
    samples = sum(panel["x"].size for panel in panels.values())
    span = log["time_[s]"].max() - log["time_[s]"].min()
    covariance = arrays[told["covariance"]]
    deviations = np.sqrt(np.diag(covariance))
    rules = [
        (r"Fit of \d+ number", [len(rows), samples, span]),
        ("name  estimate  interval of", [told["confidence"]]),
        (r"\d of \d start", [told["agreeing_starts"], told["starts"], told["confidence"]]),
        ("condition ", [told["condition_number"], covariance[0, 1] / deviations.prod()]),
        (r"Recording of log\.csv", [log.size, span, 0.1, 10.0]),
    ]
    for i, (name, row) in enumerate(rows.items()):
        estimate, low, high = (float(row[key]) for key in ("estimate", "low", "high"))
        assert float(row["standard deviation"]) == pytest.approx(deviations[i])
        rules.append((rf"{re.escape(name)}  ", [estimate, low, high, float(row["standard deviation"]) / abs(estimate)]))
        sampling = abs(arrays[told["sampling_errors"]][i])
        if sampling > 0.5 * (high - low):
            rules.append((rf"`?{re.escape(name)}`? is less sure", [sampling, sampling / (0.5 * (high - low))]))
    for residual in told["residuals"]:
        panel = panels[residual["signal"]]
        name = residual["signal"]
        counts = ~arrays[dict(told["outliers"])[name]] if name in dict(told["outliers"]) else np.ones(panel["x"].size, bool)
        measured = panel["measured"][counts]
        left = panel["model"][counts] - measured
        rms, centred = np.sqrt(np.mean(left**2)), left - left.mean()
        neighbours = centred[1:] @ centred[:-1] / (centred @ centred)
        cells = [rms, rms / np.ptp(measured), neighbours, residual["whiteness"]]
        rules.append(("they are about", [math.sqrt((1.0 + neighbours) / (1.0 - neighbours))]))
        rules.append((rf"residual of {re.escape(name)}:", cells))
        rules += [(rf"\d+ sample\(s\) of {re.escape(name)} break", [np.sum(~counts)])] * (not counts.all())
    rules += [(rf"{re.escape(name)} begins .* from the model", [far]) for name, far in dict(told["initial_mismatch"]).items()]
    for name in log.dtype.names[1:]:
        values = log[name][np.isfinite(log[name])]
        signal = name.partition("_")[0]
        read = panels[signal]["measured"] if signal in panels else values
        rules.append((rf"{re.escape(signal)} +\S+", [read.size, read.min(), read.max(), *([1, 0.0] if read.size < values.size else [])]))
    return folder, rules


def of_posterior(results):
    folder = results / "posterior"
    told, arrays = fields_of(folder / "posterior.npz")
    points = arrays[told["samples"]]
    assert points[:, 0].tolist() == [float(row["bit.weight [N]"]) for row in rows_of(folder / "posterior.csv")]
    assert told["data"] == [["severity", "1.9 +- 0.1"]] and told["priors"] == [["bit.weight", "50kN to 110kN"]]
    low, high = np.quantile(points[:, 0], (0.05, 0.95))
    cells = [each / 1e3 for each in (points.mean(), points.std(), low, high)]
    return folder, [
        (r"Posterior of ", [len(points), told["runs"], told["tempering_stages"]]),
        (r"measured severity", [1.9, 0.1]),
        (r"bit\.weight  kN ", [*cells, 50e3, 110e3]),
        (r"evidence: ", [told["log_evidence"], told["log_evidence_error"]]),
    ]


@pytest.mark.parametrize("rules_of", [of_study, of_onset, of_map, of_drives, of_fit, of_posterior])
def test_every_number_of_a_report_is_that_of_its_arrays(rules_of, results, tmp_path):
    folder, own = rules_of(results)
    page = Page(report(folder, path=tmp_path / "page.html").read_text())
    rows = [row for table in page.tables for row in table]
    lines = ["  ".join(row) for row in rows] + [line for text in page.lines for line in text.splitlines()]
    lines += [line for text in page.told for line in text.splitlines()]
    rules = [*own, *of_machine(results, folder), *of_origin(folder), *((pattern, None) for pattern in LISTED)]
    wrong, used = [], set()
    for line in map(str.strip, lines):
        found = split(line)
        if not found:
            continue
        fits = [k for k, (pattern, _) in enumerate(rules) if re.match(pattern, line)]
        expected = [rules[k][1] for k in fits]
        right = [
            k
            for k, values in zip(fits, expected, strict=True)
            if values is None or (len(values) == len(found) and all(equal(*told, value) for told, value in zip(found, values, strict=True)))
        ]
        used.update(right)
        if not right:
            wrong.append((line, expected))
    assert not wrong, "\n".join(map(str, wrong))
    assert set(range(len(own))) <= used  # everything that was looked for is on the page


def test_a_number_that_is_off_by_one_in_its_last_digit_is_seen():
    assert split("peak 199 kN m, 60 .. 110 kN, 44.4 %") == [("199", 1e3), ("60", 1e3), ("110", 1e3), ("44.4", 0.01)]
    assert equal("199", 1e3, 198968.0) and not equal("198", 1e3, 198968.0) and not equal("199", 1.0, 198968.0)
    assert equal("1.122e+04", 1.0, 11216.01) and not equal("1.121e+04", 1.0, 11216.01)
    assert equal("0.447", 1.0, 0.44746) and not equal("0.448", 1.0, 0.44746)
