"""Units as logs spell them: each as many SI as its definition says, a row of units with unknown ones, and units that are asked back."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.plants import RIG
from toolbox import SceneError
from toolbox.calibration import Recording

NAMES = {"time": "Time", "top.speed": "SURF_RPM", "top.torque": "TORQUE", "bit.weight": "WOB"}
TURN, POUND, KILOGRAM, FOOT = 2 * math.pi, 4.4482216152605, 9.80665, 0.3048


def read(path, units, names=NAMES, heads="Time,SURF_RPM,TORQUE,GASX,WOB"):
    """A log as WITSML exports have it: mnemonics, units, and rows of 1.9, 2000, 3 and 27."""
    rows = [f"2016-09-29T00:06:{28 + 2 * k:02d}.000Z,{1.9 + 0.01 * k:.2f},{2000 + k},{3 * k},{27 + k}" for k in range(10)]
    path.write_text("\n".join([heads, units, *rows]) + "\n")
    return Recording.of(path, RIG, names)


@pytest.mark.parametrize(
    "units",
    ["s,rpm,N.m,m,N", "unitless,rpm,N.m,m,N", ",rpm,N.m,m,N", "s,rpm,N.m,Euc,N", "-,rpm,N.m,-,N", "datetime,rpm,N.m,ppm,N", "hh:mm:ss,rpm,N.m,wibble,N",
     "YYYY-MM-DD,rpm,N.m,us/ft,N", "any words,rpm,N.m,gAPI,N", "unitless,rpm,N.m,unitless,N", "n/a,rpm,N.m,kcal/fortnight,N", "zork,rpm,N.m,zork,N"],
)  # fmt: skip
def test_a_row_of_units_may_hold_unknown_ones_beside_those_that_are_asked_for(tmp_path, units):
    found = read(tmp_path / "log.csv", units)
    assert found.signals["top.speed"] == pytest.approx((1.9 + 0.01 * np.arange(10)) * TURN / 60, rel=1e-12)
    assert found.time.tolist() == [2.0 * k for k in range(10)]


def test_a_row_of_units_below_names_that_are_not_asked_for_is_known_by_most_of_its_cells(tmp_path):
    rows = "\n".join(f"{k / 10},{k % 3},{k % 4}" for k in range(10))
    (tmp_path / "log.csv").write_text("time,top.torque,top.speed\nblob,kN.m,rpm\n" + rows)
    with pytest.raises(SceneError, match=r"column `time`, must have a unit of s, but it has `blob`"):
        Recording.of(tmp_path / "log.csv", RIG)


@pytest.mark.parametrize(
    ("unit", "size"),
    [("rpm", TURN / 60), ("c/s", TURN), ("c/min", TURN / 60), ("rev/s", TURN), ("rev/min", TURN / 60), ("1/min", TURN / 60), ("rps", TURN),
     ("tr/min", TURN / 60), ("U/min", TURN / 60), ("r/min", TURN / 60), ("dega/s", TURN / 360), ("deg/s", TURN / 360), ("rad/s", 1.0), ("RPM", TURN / 60),
     ("dega/min", TURN / 21_600)],
)  # fmt: skip
def test_a_speed_of_rotation_is_read_in_every_spelling(tmp_path, unit, size):
    assert read(tmp_path / "log.csv", f"s,{unit},N.m,m,N").signals["top.speed"][0] == pytest.approx(1.9 * size, rel=1e-9)


@pytest.mark.parametrize(
    ("unit", "size"),
    [
        (each, 1000 * POUND * FOOT)
        for each in ("kft-lb", "k.ft-lb", "kft*lb", "KFT-LBS", "klb-ft", "1000 ft.lbf", "kft.lbs", "kLbf.ft", "kft_lb", "klbf.ft")
    ]
    + [(each, POUND * FOOT) for each in ("ft.lbs", "ft-lbf", "ft_lb", "lb.ft", "FT-LBF", "ft.lbf", "lbf-ft")]
    + [
        ("kNm", 1000.0),
        ("kN-m", 1000.0),
        ("kN.m", 1000.0),
        ("daN.m", 10.0),
        ("Nm", 1.0),
        ("kgf.m", KILOGRAM),
        ("kg-m", KILOGRAM),
        ("tf.m", 1000 * KILOGRAM),
    ],
)
def test_a_torque_is_read_in_every_spelling(tmp_path, unit, size):
    assert read(tmp_path / "log.csv", f"s,rpm,{unit},m,N").signals["top.torque"][0] == pytest.approx(2000 * size, rel=1e-9)


@pytest.mark.parametrize(
    ("unit", "size"),
    [(each, 1000 * KILOGRAM) for each in ("kkgf", "tonne", "t", "MT", "tf", "metric ton", "tonnes", "1000 kgf")]
    + [(each, 1000 * POUND) for each in ("klbf", "klb", "Klbs", "kip", "kips", "1000 lbf", "1000 lbs", "k-lbs")]
    + [
        ("kdaN", 10_000.0),
        ("kN", 1000.0),
        ("kgf", KILOGRAM),
        ("short ton", 2000 * POUND),
        ("long ton", 2240 * POUND),
        ("lbf", POUND),
        ("daN", 10.0),
    ],
)
def test_a_force_is_read_in_every_spelling(tmp_path, unit, size):
    assert read(tmp_path / "log.csv", f"s,rpm,N.m,m,{unit}").signals["bit.weight"][0] == pytest.approx(27 * size, rel=1e-9)


@pytest.mark.parametrize("unit", ["ton", "tons", "TON", "Ton"])
@pytest.mark.parametrize("meant", ["t", "short ton", "long ton"])
def test_a_ton_is_asked_back_and_the_unit_that_is_given_answers(tmp_path, unit, meant):
    with pytest.raises(
        SceneError, match=r"column `WOB`.*three sizes.*Say which unit it is where you say which column is `bit.weight`.*--column"
    ):
        read(tmp_path / "log.csv", f"s,rpm,N.m,m,{unit}")
    size = {"t": 1000 * KILOGRAM, "short ton": 2000 * POUND, "long ton": 2240 * POUND}[meant]
    found = read(tmp_path / "log.csv", f"s,rpm,N.m,m,{unit}", {**NAMES, "bit.weight": f"WOB [{meant}]"})
    assert found.signals["bit.weight"][0] == pytest.approx(27 * size, rel=1e-9)


def test_a_unit_of_another_quantity_is_refused_with_the_conversion_and_an_unknown_one_is_asked_back(tmp_path):
    refused = {
        "s,rpm,mA,m,N": r"N m, but it has `mA`, a unit of current\. A current is no torque: multiply it by the torque constant .N m/A. first",
        "s,rpm,N.m,m,A": r"N, but it has `A`, a unit of current\. A current is no force: multiply it by the force constant .N/A. first",
        "s,rpm,kPa,m,N": r"`kPa`, a unit of pressure\. It cannot be converted to N m without another number: choose",
        "s,Hz,N.m,m,N": r"`Hz`, a unit of frequency\..*multiply it by 60.*in rpm\. Only if the heading is wrong.*`SURF_RPM .rev/s.`",
        "s,wibble,N.m,m,N": r"unknown unit `wibble`.*Say which unit it is",
    }
    for units, words in refused.items():
        with pytest.raises(SceneError, match=words):
            read(tmp_path / "log.csv", units)


@pytest.mark.parametrize(("unit", "answer"), [("Hz", TURN), ("wibble", TURN / 60), ("kPa", 1.0), ("Euc", TURN / 60)])
def test_a_unit_that_does_not_fit_is_asked_back_and_the_unit_that_is_given_answers(tmp_path, unit, answer):
    with pytest.raises(SceneError, match=rf"column `SURF_RPM`, must have a unit of rad/s, but it has `{unit}`"):
        read(tmp_path / "log.csv", f"s,{unit},N.m,m,N")
    meant = {TURN: "rev/s", TURN / 60: "rpm", 1.0: "rad/s"}[answer]
    found = read(tmp_path / "log.csv", f"s,{unit},N.m,m,N", {**NAMES, "top.speed": f"SURF_RPM [{meant}]"})
    assert found.signals["top.speed"][0] == pytest.approx(1.9 * answer, rel=1e-9)


def test_a_unit_that_is_given_against_one_that_fits_is_refused(tmp_path):
    with pytest.raises(SceneError, match="as was asked, but its heading says rpm"):
        read(tmp_path / "log.csv", "s,rpm,N.m,m,N", {**NAMES, "top.speed": "SURF_RPM [rad/s]"})


def test_a_column_whose_brackets_hold_an_unknown_unit_is_found_without_them(tmp_path):
    rows = "\n".join(f"{k},{120 + k},{k % 4 + 3}" for k in range(10))
    (tmp_path / "log.csv").write_text("Time [s],Rotary (wibble),TQ [kN m]\n" + rows)
    names = {"time": "Time", "top.torque": "TQ"}
    with pytest.raises(SceneError, match="must have a unit of rad/s, but it has `wibble`"):
        Recording.of(tmp_path / "log.csv", RIG, {**names, "top.speed": "Rotary"})
    found = Recording.of(tmp_path / "log.csv", RIG, {**names, "top.speed": "Rotary [rpm]"})
    assert found.signals["top.speed"][0] == pytest.approx(120 * TURN / 60)


def weighed(path, weight):
    rows = [f"{k / 10:.1f},{9 + 0.01 * (k % 7):.2f},9,{each:.1f}" for k, each in enumerate(weight)]
    path.write_text("\n".join(["time [s],top.torque [kN m],top.speed [rad/s],bit.weight [N]", *rows]))
    return path


def test_noise_of_the_weight_below_zero_is_a_flaw_and_counts_as_no_weight(tmp_path):
    weight = np.where(np.arange(600) < 200, 0.0, 90e3) + 1500.0 * np.random.default_rng(0).standard_normal(600)
    found = Recording.of(weighed(tmp_path / "log.csv", weight), RIG)
    assert found.found("bit.weight") == {"below zero": int((np.round(weight, 1) < 0).sum())}
    assert found.signals["bit.weight"] == pytest.approx(np.maximum(np.round(weight, 1), 0.0))
    assert "set the sensor to zero off bottom, or take a window (--window, in Python `between`)" in str(found)


def test_a_weight_that_is_far_below_zero_for_long_is_left_out_or_refused_with_where_it_begins(tmp_path):
    noise = 500.0 * np.random.default_rng(1).standard_normal(600)
    found = Recording.of(weighed(tmp_path / "some.csv", np.where(np.arange(600) < 100, -40e3, 90e3) + noise), RIG)
    assert np.isnan(found.signals["bit.weight"][:100]).all() and "100 farther below left out" in str(found)
    with pytest.raises(
        SceneError, match=r"`bit.weight` must be >= 0 N, but it is below in 600 of 600 samples, down to -\d+ N, first at 0 s: turn its sign"
    ):
        Recording.of(weighed(tmp_path / "all.csv", -90e3 + noise), RIG)


@pytest.mark.parametrize("codec", ["utf-16-le", "utf-16-be"])
def test_a_table_in_utf_16_without_its_mark_is_read(tmp_path, codec):
    text = "time [s],top.torque [kN m],top.speed [rpm]\n" + "\n".join(f"{k},{k % 5},{100 + k}" for k in range(60))
    (tmp_path / "log.csv").write_bytes(text.encode(codec))
    assert Recording.of(tmp_path / "log.csv", RIG).signals["top.torque"].tolist() == [1000.0 * (k % 5) for k in range(60)]


def test_32767_means_no_value(tmp_path):
    weight = np.full(60, 90e3) + np.arange(60)
    weight[20] = 32767.0
    assert Recording.of(weighed(tmp_path / "log.csv", weight), RIG).found("bit.weight") == {"null": 1}


def test_the_columns_of_a_matrix_in_a_mat_file_are_asked_for_by_their_numbers(tmp_path):
    from scipy.io import savemat

    k = np.arange(60.0)
    savemat(tmp_path / "log.mat", {"log": np.column_stack([k, 9e3 + k % 7, 9.0 + 0.1 * (k % 5)])})
    found = Recording.of(tmp_path / "log.mat", RIG, {"time": "log.0 [min]", "top.torque": "log.1", "top.speed": "log.2 [rpm]"})
    assert found.time == pytest.approx(60.0 * k) and found.signals["top.torque"] == pytest.approx(9e3 + k % 7)
    assert found.signals["top.speed"] == pytest.approx((9.0 + 0.1 * (k % 5)) * TURN / 60)
    with pytest.raises(SceneError, match=r"must have `log`, but it is not there: .*`log.0`"):
        Recording.of(tmp_path / "log.mat", RIG, {"time": "log.0", "top.torque": "log"})
