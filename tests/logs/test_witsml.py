"""Logs in WITSML 1.3.1 and 1.4.1: read as they are declared; a document type, damage and logs over depth are one line."""

from __future__ import annotations

import math
import tracemalloc

import numpy as np
import pytest

from tests.plants import RIG
from toolbox import SceneError
from toolbox.calibration import Recording

COLUMNS = {"top.torque": "TQ", "top.speed": "RPM"}
HEADS, UNITS = ["Time", "TQ", "GASX", "RPM"], ["unitless", "kft.lbf", "Euc", "c/s"]
POUND_FOOT = 4.4482216152605 * 0.3048


def rows(count=30, step=2, first=0):
    cells = []
    for k in range(first, first + count):
        seconds = step * k
        stamp = f"2016-09-29T{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}.000Z"
        cells.append(f"{stamp},{10 + k % 7},{k},{2 + 0.125 * (k % 5)}")
    return cells


def document(
    data, *, index="date time", head="", version="1.4.1.1", lists=True, curves=HEADS, units=UNITS, before="", logs=1, prefix="", curve=""
):
    """A WITSML document; lists: names and units stand in `mnemonicList` and `unitList`, as from 1.4.1 on."""
    p = prefix
    infos = "".join(
        f"<{p}logCurveInfo uid='{name}'><{p}mnemonic>{name}</{p}mnemonic><{p}unit>{unit}</{p}unit>"
        + (curve if name == "TQ" else "")
        + ("" if lists else f"<{p}columnIndex>{k + 1}</{p}columnIndex>")
        + f"</{p}logCurveInfo>"
        for k, (name, unit) in enumerate(zip(curves, units, strict=True))
    )
    if not lists:
        infos = "".join(reversed([f"<{p}logCurveInfo{each}" for each in infos.split(f"<{p}logCurveInfo")[1:]]))  # in any order
    named = f"<{p}mnemonicList>{','.join(curves)}</{p}mnemonicList><{p}unitList>{','.join(units)}</{p}unitList>" if lists else ""
    table = "".join(f"<{p}data>{row}</{p}data>" for row in data)
    one = (
        f"<{p}log uid='a'><{p}nameWell>A &amp; B</{p}nameWell><{p}name>rig</{p}name><{p}indexType>{index}</{p}indexType>"
        f"<{p}indexCurve>{curves[0]}</{p}indexCurve>{head}{infos}<{p}logData>{named}{table}</{p}logData></{p}log>"
    )
    space = f"xmlns{':' + p[:-1] if p else ''}='http://www.witsml.org/schemas/1series'"
    return f"<?xml version='1.0' encoding='UTF-8'?>\n{before}<{p}logs {space} version='{version}'>{one * logs}</{p}logs>"


def saved(path, text):
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def expect_right(found, count=30):
    k = np.arange(count)
    assert found.time == pytest.approx(2.0 * k)
    assert found.signals["top.torque"] == pytest.approx((10.0 + k % 7) * 1000 * POUND_FOOT, rel=1e-9)
    assert found.signals["top.speed"] == pytest.approx((2 + 0.125 * (k % 5)) * 2 * math.pi, rel=1e-9)


@pytest.mark.parametrize("name", ["log.xml", "log.witsml", "log.txt"])
@pytest.mark.parametrize(("lists", "version", "prefix"), [(True, "1.4.1.1", ""), (True, "1.4.1.1", "w:"), (False, "1.3.1.1", "")])
def test_a_log_over_time_is_read_in_the_units_that_it_declares(tmp_path, name, lists, version, prefix):
    found = Recording.of(saved(tmp_path / name, document(rows(), lists=lists, version=version, prefix=prefix)), RIG, COLUMNS)
    expect_right(found)
    assert "WITSML log `rig`" in str(found)


@pytest.mark.parametrize("codec", ["utf-8", "utf-8-sig", "utf-16"])
def test_a_log_is_read_in_every_alphabet(tmp_path, codec):
    expect_right(Recording.of(saved(tmp_path / "log.xml", document(rows()).encode(codec)), RIG, COLUMNS))


def test_the_index_is_the_time_whatever_its_name(tmp_path):
    text = document(rows(), curves=["IDX", *HEADS[1:]])
    expect_right(Recording.of(saved(tmp_path / "log.xml", text), RIG, COLUMNS))


def test_an_elapsed_time_has_the_unit_of_its_curve(tmp_path):
    data = [f"{k / 30},{10 + k % 7},0,{2 + 0.125 * (k % 5)}" for k in range(30)]
    text = document(data, index="elapsed time", units=["min", *UNITS[1:]])
    expect_right(Recording.of(saved(tmp_path / "log.xml", text), RIG, COLUMNS))


def test_a_log_whose_direction_is_decreasing_is_turned(tmp_path):
    text = document(rows()[::-1], head="<direction>decreasing</direction>")
    expect_right(Recording.of(saved(tmp_path / "log.xml", text), RIG, COLUMNS))


def test_nulls_of_the_log_and_of_one_curve_are_no_values(tmp_path):
    data = rows()
    for k, null in ((3, "-888"), (4, "-77"), (5, "")):
        cells = data[k].split(",")
        data[k] = ",".join([cells[0], null, cells[2], cells[3]])
    text = document(data, head="<nullValue>-888</nullValue>", curve="<nullValue>-77</nullValue>")
    found = Recording.of(saved(tmp_path / "log.xml", text), RIG, COLUMNS, accepted_flaws=["outlier"])
    assert found.found("top.torque") == {"null": 3} and np.isnan(found.signals["top.torque"][3:6]).all()
    assert found.found("top.speed") == {}  # the null of one curve is a number in another


def test_logs_of_one_kind_in_a_file_go_on_after_each_other(tmp_path):
    parts = [document(rows(15, first=first)).split("<log ")[1].split("</logs>")[0] for first in (0, 15)]
    text = document(rows()).split("<log ")[0] + "".join("<log " + part for part in parts) + "</logs>"
    expect_right(Recording.of(saved(tmp_path / "log.xml", text), RIG, COLUMNS))


def test_of_logs_with_different_mnemonics_the_one_with_all_that_is_asked_for_is_read(tmp_path):
    own, other = document(rows()), document([row.replace("Z,", "Z,1") for row in rows()], curves=["Time", "TQ2", "GASX", "RPM2"])
    text = own.replace("</logs>", "<log " + other.split("<log ")[1])
    expect_right(Recording.of(saved(tmp_path / "log.xml", text), RIG, COLUMNS))
    with pytest.raises(SceneError, match=r"must have `TQ9`, but it is not there"):
        Recording.of(tmp_path / "log.xml", RIG, {**COLUMNS, "top.torque": "TQ9"})
    with pytest.raises(SceneError, match=r"must hold one log over time with all columns.*save the one that is meant"):
        Recording.of(tmp_path / "log.xml", RIG, {"top.torque": "TQ", "top.speed": "RPM2"})


def test_rows_of_another_length_are_left_out_and_told(tmp_path):
    data = rows()
    data.insert(7, "2016-09-29T00:00:13.000Z,1")
    found = Recording.of(saved(tmp_path / "log.xml", document(data)), RIG, COLUMNS)
    expect_right(found)
    assert "1 row(s) of another length than the 4 mnemonics left out" in str(found)
    with pytest.raises(SceneError, match="must have 4 cells in every `data`, one for each mnemonic"):
        Recording.of(saved(tmp_path / "log.xml", document([row + ",1" for row in rows()])), RIG, COLUMNS)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (document(rows(), index="measured depth"), "must be a log over time, but it is one over depth"),
        (document([]), "must hold rows in `data`"),
        (
            "<?xml version='1.0'?><logs/>",
            "must be a log in WITSML 1.4.1, whose first element is `logs`, but it is XML whose first element is `logs`",
        ),
        ("<?xml version='1.0'?><trajectorys><trajectory/></trajectorys>", "but it is XML whose first element is `trajectorys`"),
        ("<html><body>no log</body></html>", "but it is XML whose first element is `html`"),
        (document(rows())[:-9], "must be whole XML, but it cannot be read"),
        (document(rows()).replace("</logCurveInfo>", "</curve>"), "must be whole XML"),
        ("<?xml version='1.0'?>" + "<a>" * 200 + "</a>" * 200, "at most 100 elements in one another"),
        (document(rows()).replace("GASX", "&gas;"), "must be whole XML"),
    ],
)
def test_what_is_no_log_over_time_is_one_line(tmp_path, text, said):
    with pytest.raises(SceneError, match=said) as refusal:
        Recording.of(saved(tmp_path / "log.xml", text), RIG, COLUMNS)
    assert "\n" not in str(refusal.value) and "log.xml" in str(refusal.value)


LAUGHS = (
    "<!DOCTYPE l [<!ENTITY a 'ha'>"
    + "".join(f"<!ENTITY {b} '{f'&{a};' * 10}'>" for a, b in zip("abcdefgh", "bcdefghi", strict=True))
    + "]>"
)


@pytest.mark.parametrize(
    "declared",
    [
        LAUGHS,
        "<!DOCTYPE l [<!ENTITY x SYSTEM 'file:///etc/passwd'>]>",
        "<!DOCTYPE l SYSTEM 'http://127.0.0.1:9/evil.dtd'>",
        "<!DOCTYPE l [<!ENTITY % p SYSTEM 'http://127.0.0.1:9/evil.dtd'> %p;]>",
        "<!DOCTYPE logs>",
        "<!-- a --><!DOCTYPE logs [ ]>",
    ],
    ids=["a thousand million laughs", "a file", "a document type elsewhere", "a parameter", "a bare document type", "behind a comment"],
)
@pytest.mark.parametrize("codec", ["utf-8", "utf-16", "utf-16-le"])
def test_a_document_type_is_refused_before_anything_is_parsed(tmp_path, declared, codec):
    text = document([row.replace("2016", "&i;") for row in rows()], before=declared)
    saved(tmp_path / "log.xml", text.encode(codec))
    tracemalloc.start()
    try:
        with pytest.raises(SceneError, match="without a document type and without entities of its own, but it has `<!DOCTYPE`"):
            Recording.of(tmp_path / "log.xml", RIG, COLUMNS)
        assert tracemalloc.get_traced_memory()[1] < 2**22
    finally:
        tracemalloc.stop()


def test_a_file_above_the_bound_of_tables_is_refused_before_it_is_read(tmp_path):
    path = saved(tmp_path / "log.xml", document(rows()))
    with path.open("r+b") as file:
        file.truncate(257 * 2**20)
    with pytest.raises(SceneError, match="must be of at most 256 MiB"):
        Recording.of(path, RIG, COLUMNS)
