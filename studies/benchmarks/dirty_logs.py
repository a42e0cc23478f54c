"""Forty-two dirty logs whose truth is known: are all read right with every flaw told, or refused with what to do?

    python -m studies dirty_logs

Every log holds 60 s of a rig that sticks and slips at 10 samples per second, written in one of the ways of recorders, with one of their flaws. What was damaged
is known, so that what is read can be compared with what was true: a sample that was damaged must be left out, one that was not must be there.
"""

from __future__ import annotations

import datetime
import math
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from models import BitRock, wells
from toolbox import SceneError, compose, simulate
from toolbox.calibration import Recording

RIG = compose(wells.JANSEN_2, BitRock())
COLUMNS = {"top.torque": "TQ", "bit.weight": "WOB", "bit.speed": "RPM BIT"}
UNITS = {"TQ": ("kft.lbf", 1355.8179483314004), "WOB": ("klbf", 4448.2216152605), "RPM BIT": ("rpm", math.pi / 30)}
BEGIN = datetime.datetime(2024, 3, 30, 23, 59, 45, tzinfo=datetime.UTC)
DIGITS = 6


@dataclass
class Log:
    """A log and its truth. expected: {channel: {kind of flaw: samples}} that must be told;  lost: samples that are no data;  refusal: words of the error."""

    path: Path
    columns: dict[str, str] | None
    expected: dict[str, dict[str, int]] = field(default_factory=dict)
    lost: dict[str, np.ndarray] = field(default_factory=dict)
    refusal: str = ""
    options: dict[str, Any] = field(default_factory=dict)
    rows: np.ndarray | None = None


@cache
def truth() -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times [s] and numbers in the units of the log."""
    time = np.round(np.arange(600) / 10, 1)
    torque = 10_500.0 + 1500.0 * np.sin(0.25 * time)
    weight = 95_000.0 + 4000.0 * np.sin(0.4 * time)
    run = simulate(RIG, 60.0, inputs={"top.torque": (time, torque), "bit.weight": (time, weight)}, output_times=time, accuracy=1e-6)
    random = np.random.default_rng(2)
    signals = {
        "TQ": torque + 100.0 * random.standard_normal(600),
        "WOB": weight + 500.0 * random.standard_normal(600),
        "RPM BIT": run["bit.speed"],
    }
    signals["RPM BIT"] = signals["RPM BIT"] + 0.05 * random.standard_normal(600)
    return time, {name: np.round(values / UNITS[name][1], DIGITS) for name, values in signals.items()}


def text(
    mark: str = ",",
    heading: Callable[[str, str], str] = lambda name, unit: f"{name} [{unit}]",
    number: Callable[[float], str] = lambda value: f"{value:.6f}",
    times: Callable[[float], str] = lambda t: f"{t:.1f}",
    time_heading: str = "time [s]",
    above: str = "",
    below_headings: str = "",
    cells: dict[str, dict[int, str]] | None = None,
    order: Any = None,
    numbers: dict[str, np.ndarray] | None = None,
) -> str:
    """A log in text."""
    time, values = truth()
    values = {**values, **(numbers or {})}
    lines = [mark.join([time_heading, *(heading(name, UNITS[name][0]) for name in values)])]
    for k in range(time.size) if order is None else order:
        row = [times(float(time[k]))] + [(cells or {}).get(name, {}).get(k, number(float(column[k]))) for name, column in values.items()]
        lines.append(mark.join(row))
    return above + lines[0] + "\n" + below_headings + "\n".join(lines[1:]) + "\n"


def witsml() -> str:
    """A log in WITSML 1.4.1 with two values of its own null, and a channel with a unit that nobody knows."""
    time, values = truth()
    heads = ["Time", *(name.replace(" ", "") for name in values), "GASX"]
    curves = "".join(f"<logCurveInfo uid='{head}'><mnemonic>{head}</mnemonic></logCurveInfo>" for head in heads)
    rows = []
    for k in range(time.size):
        cells = [f"{column[k]:.6f}" for column in values.values()]
        rows.append(",".join([moment(float(time[k]), "Z"), *(["-888"] if k in (40, 41) else cells[:1]), *cells[1:], "0"]))
    units = ",".join(["unitless", *(UNITS[name][0] for name in values), "Euc"])
    data = "".join(f"<data>{row}</data>" for row in rows)
    return (
        "<?xml version='1.0' encoding='UTF-8'?><logs xmlns='http://www.witsml.org/schemas/1series' version='1.4.1.1'><log><name>drilling</name>"
        f"<indexType>date time</indexType><indexCurve>Time</indexCurve><nullValue>-888</nullValue>{curves}<logData>"
        f"<mnemonicList>{','.join(heads)}</mnemonicList><unitList>{units}</unitList>{data}</logData></log></logs>"
    )


def german(value: float) -> str:
    """1234.5 as 1.234,5."""
    return f"{value:,.6f}".translate(str.maketrans(",.", ".,"))


def moment(t: float, zone: str = "") -> str:
    """An ISO time."""
    return (BEGIN + datetime.timedelta(seconds=t)).replace(tzinfo=None).isoformat(timespec="milliseconds") + zone


def damaged(name: str, places: list[int], change: Callable[[np.ndarray], Any]) -> dict[str, np.ndarray]:
    """A channel with other numbers at some places."""
    values = truth()[1][name].copy()
    values[places] = change(values[places])
    return {name: values}


def _big(count: int, seed: int) -> list[int]:
    """Places, apart from each other, at which the bit turns fast."""
    speed = truth()[1]["RPM BIT"]
    random, found = np.random.default_rng(seed), []
    for k in random.permutation(np.flatnonzero(speed > 60.0)).tolist():
        if 5 < k < 594 and all(abs(k - other) > 6 for other in found):
            found.append(k)
    return sorted(found[:count])


def _frame(index: Any = None) -> Any:
    import pandas

    time, values = truth()
    table = pandas.DataFrame({f"{name} [{UNITS[name][0]}]": column for name, column in values.items()})
    if index is None:
        table.insert(0, "time [s]", time)
    else:
        table.index = index
    return table


def formats(folder: Path) -> dict[str, Log]:
    """Twenty ways to write the same log."""
    logs: dict[str, Log] = {}

    def add(name: str, content: str | bytes, columns: dict[str, str] | None = None, suffix: str = ".csv", **more: Any) -> None:
        path = folder / f"{name.replace(' ', '_')}{suffix}"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        logs[name] = Log(path, {**COLUMNS, **(columns or {})}, **more)

    add("commas", text())
    add(
        "semicolons and decimal commas",
        text(";", number=lambda v: f"{v:.6f}".replace(".", ","), times=lambda t: f"{t:.1f}".replace(".", ",")),
    )
    add("decimal commas and points for thousands", text(";", number=german, times=lambda t: f"{t:.1f}".replace(".", ",")))
    add("thousands in quotes", text(number=lambda v: f'"{1000 * v:,.9f}"', heading=lambda n, u: f"{n} [{ {'TQ': 'ft.lbf', 'WOB': 'lbf'}.get(n, 'rad/s') }]",
        numbers={"RPM BIT": truth()[1]["RPM BIT"] * math.pi / 30 / 1000}))  # fmt: skip
    add("tabulators and round brackets", text("\t", heading=lambda n, u: f"{n} ({u})", time_heading="time (s)"))
    add(
        "spaces",
        "# made by a recorder\n" + text(" ").replace("RPM BIT", "RPMBIT").replace("time [s]", "time[s]").replace(" [", "["),
        {"bit.speed": "RPMBIT"},
        ".dat",
    )
    add("a preamble", text(above="Well: A-7\nRig: 12, crew 3\nRecorder v2.1; serial 77\n\n"))
    add("units in the second line", text(heading=lambda n, u: n, time_heading="time", below_headings="s,kft.lbf,klbf,rpm\n"))
    add(
        "units given",
        text(heading=lambda n, u: n, time_heading="time"),
        {"time": "time [s]", **{s: f"{h} [{UNITS[h][0]}]" for s, h in COLUMNS.items()}},
    )
    add(
        "latin-1",
        text(heading=lambda n, u: f"{n.replace('TQ', 'Couple à la table')} [{u}]").encode("latin-1"),
        {"top.torque": "Couple à la table"},
    )
    add("utf-16", text().encode("utf-16"))
    add("a byte order mark and carriage returns", ("\ufeff" + text()).replace("\n", "\r\n"))
    add("ISO times with a zone", text(times=lambda t: moment(t, "Z"), time_heading="timestamp"))
    add("ISO times without a zone", text(times=moment, time_heading="DateTime"))
    add("milliseconds since 1970", text(times=lambda t: f"{1000 * (BEGIN.timestamp() + t):.0f}", time_heading="time"))
    add("date and time of day apart", text(times=lambda t: moment(t).replace("T", ","), time_heading="Date,Time"))
    add("units in capitals", text(heading=lambda n, u: f"{n} ({u.upper()})", time_heading="TIME (SEC)"))
    las = text(" ", number=lambda v: f"{v:.6f}").split("\n", 1)[1]
    head = "~V\nVERS. 2.0 :\nWRAP. NO :\n~W\nSTRT.S 0 :\nSTOP.S 59.9 :\nSTEP.S 0.1 :\nNULL. -888 :\n~C\nTIME.S :\nTQ.KFT.LBF :\nWOB.KLBF :\nRPM.RPM :\n~A\n"
    spoilt = las.split("\n")
    for k in (40, 41):
        spoilt[k] = " ".join([spoilt[k].split()[0], "-888", *spoilt[k].split()[2:]])
    add(
        "LAS with its own null",
        head + "\n".join(spoilt),
        {"bit.speed": "RPM"},
        ".las",
        expected={"top.torque": {"null": 2}},
        lost={"TQ": np.array([40, 41])},
    )
    time, values = truth()
    import h5py
    import pandas

    with h5py.File(folder / "new.mat", "w", userblock_size=512) as file:
        file["time"] = time[None, :]
        for name, column in values.items():
            file[name.replace(" ", "")] = column[None, :] * UNITS[name][1]
    with (folder / "new.mat").open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    logs["MAT 7.3"] = Log(folder / "new.mat", {**COLUMNS, "bit.speed": "RPMBIT"})
    _frame().to_excel(folder / "log.xlsx", index=False)
    logs["xlsx"] = Log(folder / "log.xlsx", COLUMNS)
    _frame(pandas.DatetimeIndex([BEGIN + datetime.timedelta(seconds=t) for t in time.tolist()], name="when")).to_parquet(
        folder / "log.parquet"
    )
    logs["parquet over dates"] = Log(folder / "log.parquet", {**COLUMNS, "time": "when"})
    return logs


def flaws(folder: Path) -> dict[str, Log]:
    """Flaws of samples, and logs that cannot be read as they are."""
    logs: dict[str, Log] = {}

    def add(name: str, content: str, **more: Any) -> None:
        path = folder / f"{name.replace(' ', '_').replace('.', '')}{more.pop('suffix', '.csv')}"
        path.write_text(content)
        logs[name] = Log(path, {**COLUMNS, **more.pop("columns", {})}, **more)

    def cells(name: str, words: str, places: list[int], channel: str = "WOB", kind: str = "null", **more: Any) -> None:
        signal = next(key for key, heading in COLUMNS.items() if heading == channel)
        add(
            name,
            text(cells={channel: dict.fromkeys(places, words)}),
            expected={signal: {kind: len(places)}},
            lost={channel: np.array(places)},
            **more,
        )

    cells("null -999.25", "-999.25", [10, 11, 300])
    cells("null -32768", "-32768", [10, 11, 300])
    cells("null 1e30", "1e30", [10, 599])
    cells("a declared null", "-1111", [50, 51], options={"nulls": (-1111.0,)})
    cells("empty cells", "", [0, 70, 71])
    cells("words in cells", "Sensor fault", [90])
    cells("drop-outs to zero", "0", [100, 101, 102, 400], kind="drop-out")
    speed, torque = truth()[1]["RPM BIT"], truth()[1]["TQ"]
    clipped = np.minimum(speed, np.quantile(speed, 0.97))
    at = np.flatnonzero(clipped == clipped.max())
    add("clipping", text(numbers={"RPM BIT": clipped}), expected={"bit.speed": {"clipped": at.size}}, lost={"RPM BIT": at})
    turned = _big(5, 1)
    add(
        "reversed speed",
        text(numbers=damaged("RPM BIT", turned, lambda v: -v)),
        expected={"bit.speed": {"reversed": 5}},
        lost={"RPM BIT": np.array(turned)},
    )
    odd = [33, 210, 500]
    add(
        "jumps of an encoder",
        text(numbers=damaged("RPM BIT", odd, lambda v: v + 32768.0)),
        expected={"bit.speed": {"outlier": 3}},
        lost={"RPM BIT": np.array(odd)},
    )
    everything = np.arange(600)
    gap = np.setdiff1d(everything, np.arange(200, 230))
    add("a gap of three seconds", text(order=gap), expected={"time": {"gap": 1}}, rows=gap)
    few = np.setdiff1d(everything, [50, 51, 300])
    add("two gaps", text(order=few), expected={"time": {"gap": 2}}, rows=few)
    add(
        "rows written twice", text(order=np.sort(np.append(everything, [20, 21, 400]))), expected={"time": {"repeated": 3}}, rows=everything
    )
    late = np.concatenate([np.arange(300), np.arange(290, 298), np.arange(300, 600)])
    add("a block written again", text(order=late), expected={"time": {"repeated": 8}}, rows=everything)
    back = [f"{t:.1f}" for t in truth()[0].tolist()]
    back[250] = "3.05"
    add(
        "a time that goes back",
        text(times=lambda t: back[round(t * 10)]),
        expected={"time": {"backward": 1, "gap": 1}},
        rows=np.setdiff1d(everything, [250]),
    )
    short = text().split("\n")
    short[100] = short[100].split(",")[0]
    add("a row that is cut short", "\n".join(short), expected={"time": {"gap": 1}}, rows=np.setdiff1d(everything, [99]))
    add("a heading mistyped", text(), columns={"bit.weight": "WBO"}, refusal="did you mean `WOB`")
    add("no units", text(heading=lambda n, u: n, time_heading="time"), refusal="must name its unit")
    add(
        "days or months",
        text(times=lambda t: f"{3 + int(t // 30):02d}/04/2024 10:{int(t) // 60:02d}:{t % 60:04.1f}", time_heading="time"),
        refusal="day and month",
    )
    add(
        "thousands or decimals",
        "time [s];TQ [N m];WOB [N];RPM BIT [rpm]\n" + "".join(f"{k};1,{k + 100};2,{k + 200};3,{k + 300}\n" for k in range(9)),
        refusal="decimal=",
    )
    add(
        "WITSML",
        witsml(),
        suffix=".xml",
        columns={"bit.speed": "RPMBIT"},
        expected={"top.torque": {"null": 2}},
        lost={"TQ": np.array([40, 41])},
    )
    assert torque.size == 600
    return logs


def made(folder: Path) -> dict[str, Log]:
    """{name: log} of all, written into a folder."""
    return {**formats(folder), **flaws(folder)}


def faults(log: Log) -> list[str]:
    """What is not as it must be, in words; none where the log is read right, or refused as it should be."""
    try:
        found = Recording.of(log.path, RIG, log.columns, **log.options)
    except SceneError as error:
        return [] if log.refusal and log.refusal in str(error) else [f"refused: {error}"]
    if log.refusal:
        return ["read, and should be refused"]
    said = []
    time, values = truth()
    rows = np.arange(time.size) if log.rows is None else log.rows
    if found.time.size != rows.size or not np.allclose(found.time, time[rows] - time[rows[0]], atol=1e-6):
        said.append(f"times: {found.time.size} samples for {rows.size}")
        return said
    for signal, heading in COLUMNS.items():
        got, true = found.signals[signal], values[heading][rows] * UNITS[heading][1]
        lost = np.isin(rows, log.lost.get(heading, []))
        wrong = np.isfinite(got) & ~np.isclose(got, true, rtol=1e-9, atol=1e-6 * np.abs(true).max())
        if wrong.any():
            said.append(f"{signal}: {int(wrong.sum())} samples are wrong")
        if (np.isnan(got) != lost).any():
            said.append(
                f"{signal}: {int((np.isnan(got) & ~lost).sum())} good samples left out, {int((~np.isnan(got) & lost).sum())} bad ones kept"
            )
    for channel in ("time", *COLUMNS):
        if found.found(channel) != log.expected.get(channel, {}):
            said.append(f"{channel}: told {found.found(channel)} for {log.expected.get(channel, {})}")
    return said


def main() -> int:
    """Read all, and say what came. Returns the number of logs that are not as they must be."""
    bad = 0
    with tempfile.TemporaryDirectory() as folder:
        logs = made(Path(folder))
        for name, log in logs.items():
            found = faults(log)
            bad += bool(found)
            print(f"{name:<40} {'; '.join(found) or ('refused with what to do' if log.refusal else 'right, every flaw told')}")
    print(f"{len(logs) - bad} of {len(logs)} logs are read right with every flaw told, or refused with what to do")
    return bad


if __name__ == "__main__":
    sys.exit(main())
