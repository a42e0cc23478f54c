"""Quantities with units: exact conversions, and an error for everything that is not one."""

import contextlib
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.refusals import each_of, refusals
from toolbox import SceneError
from toolbox.files import units
from toolbox.files.plain_units import plain
from toolbox.files.unit_systems import SYSTEMS
from toolbox.files.units import HABITS, MISTAKEN, USUAL, parse

EXACT = [
    ("97.3 kN", "N", 97_300.0),
    ("97.347 kN", "N", 97_347.0),
    ("0.1 kN", "N", 100.0),
    ("-3 kN", "N", -3000.0),
    ("1_000 N", "N", 1000.0),
    (".5 kN", "N", 500.0),
    ("1e3 N", "N", 1000.0),
    ("97.3kN", "N", 97_300.0),
    ("1 klbf", "N", 4448.2216152605),  # by definition: 0.45359237 kg times 9.80665 m/s2
    ("1 lbf", "N", 4.4482216152605),
    ("1 ft", "m", 0.3048),
    ("12.25 in", "m", 0.31115),
    ("12 1/4 in", "m", 0.31115),
    ("6-3/4 in", "m", 0.17145),
    ("1.3 SG", "kg/m3", 1300.0),
    ("10 lbm/gal", "kg/m3", 1198.2642731689664),
    ("120 r/min", "rad/s", 4 * math.pi),
    ("120 rpm", "rad/s", 4 * math.pi),
    ("1 rev/s", "rad/s", 2 * math.pi),
    ("180 deg", "rad", math.pi),
    ("180 °", "rad", math.pi),
    ("90 deg/s", "rad/s", math.pi / 2),
    ("10 kN m", "N m", 10_000.0),
    ("10 kNm", "N m", 10_000.0),
    ("10 kN*m", "N m", 10_000.0),
    ("10 kN·m", "N m", 10_000.0),
    ("2 h", "s", 7200.0),
    ("10 ms", "s", 0.01),
    ("5 Hz", "Hz", 5.0),
    ("5 1/s", "Hz", 5.0),
    ("0.4 1/s", "1/s", 0.4),
    ("23.2 N m s/rad", "N m s/rad", 23.2),
    ("4 kN m s/rad", "N m s/rad", 4000.0),
    ("473 N m/rad", "N m/rad", 473.0),
    ("0.9 s/rad", "s/rad", 0.9),
    ("2122 kg m2", "kg m2", 2122.0),
    ("2 t m^2", "kg m2", 2000.0),
    ("3 m/s²", "m/s2", 3.0),
    ("30 %", "1", 0.3),
    ("0.8", "1", 0.8),
    ("20 degC", "K", 293.15),
    ("5 7/8 in", "m", 0.149225),  # as drillers write the size of a bit or a casing
    ("9-5/8 in", "m", 0.244475),
    ("7/8 in", "m", 0.022225),
    ("-1 1/2 ft", "m", -0.4572),
    ("5 1/s", "1/s", 5.0),  # no fraction of the number, but a unit
    ("2 1/2 1/s", "1/s", 2.5),
    ("3 deg/30m", "rad/m", math.pi / 1800),  # severity of a dogleg
    ("3 ° / 30 m", "rad/m", math.pi / 1800),
    ('5 7/8"', "m", 0.149225),
    ('12¼"', "m", 0.31115),
    ("5½ in", "m", 0.1397),
    ("9-⅝ in", "m", 0.244475),
    ("⅞ in", "m", 0.022225),
    ("5 1⁄2”", "m", 0.1397),
    ("9 5/8''", "m", 0.244475),
    ("6'", "m", 1.8288),
    ("3 deg/100 ft", "rad/m", math.pi / 1828.8),
]


@pytest.mark.parametrize(("text", "unit", "value"), EXACT)
def test_a_text_with_a_unit_is_the_nearest_double_of_its_exact_value(text, unit, value):
    assert parse(text, unit) == value


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_number_is_si_and_passes_unchanged(number):
    assert parse(number, "N") == number


@given(st.floats(min_value=-1e12, max_value=1e12))
def test_writing_a_number_with_its_own_unit_changes_nothing(number):
    assert parse(f"{number!r} N m s/rad", "N m s/rad") == number


def test_numpy_numbers_and_integers_are_numbers():
    assert parse(np.float64(2.5), "N") == 2.5
    assert parse(np.int64(2), "N") == 2.0
    assert type(parse(7, "N")) is float


@pytest.mark.parametrize("unit", USUAL)
def test_every_unit_that_an_error_may_suggest_is_known_and_fits_itself(unit):
    assert parse(f"1.5 {unit}", unit) == 1.5


def test_beside_a_force_the_angle_may_be_left_out_and_is_converted_where_it_is_given():
    assert parse("473 N m", "N m/rad") == 473.0
    assert parse("5 N m/rad", "N m") == 5.0
    assert parse("1 N m/deg", "N m/rad") == pytest.approx(180 / math.pi, rel=1e-15)


def test_errors_name_the_argument_what_must_hold_and_what_came():
    with pytest.raises(SceneError) as caught:
        parse("97 kg", "N", "bit.weight")
    assert str(caught.value) == "Argument `bit.weight` must be in N, but `97 kg` is in kg."
    with pytest.raises(SceneError) as caught:
        parse("97", "N", "bit.weight")
    assert str(caught.value) == "Argument `bit.weight` must be in N, but `97` has no unit: write a plain number, or `97 N`."


@pytest.mark.parametrize(
    ("text", "unit", "hint"),
    [
        ("97 MKN", "N", "`MN`"),
        ("12 rpmm", "rad/s", "`rpm`"),
        ("3 klbff", "N", "`klbf`"),
        ("3 kNn m", "N m", "`kN m`"),
        ("1.2 sgx", "kg/m3", "`kg/m3`"),
    ],
)
def test_an_unknown_unit_is_answered_with_units_that_fit(text, unit, hint):
    with pytest.raises(SceneError, match="unknown unit") as caught:
        parse(text, unit)
    assert hint in str(caught.value)


BROKEN = ["", " ", "N", "kN 97", "nan N", "inf N", "-inf N", "1e999 N", "1e9999 N", "97,347 N", "1.2.3 N", "1 2 N", "1 N 3", "(((", "1 (((", "1 N/0",
          "1 N; import os", "1 __import__('os')", "1 N**99999999999", "1e5", "--1 N", "0x10 N"]  # fmt: skip


def test_a_part_that_declares_an_unknown_unit_still_takes_plain_numbers():
    assert parse(3.0, "furlong/bogus") == 3.0
    with pytest.raises(SceneError, match="plain number"):
        parse("3 m", "furlong/bogus")


@given(st.text(max_size=20))
def test_no_text_whatever_raises_anything_but_a_scene_error(text):
    with contextlib.suppress(SceneError):
        assert math.isfinite(parse(text, "N"))


@pytest.mark.parametrize(
    "value",
    [10**1_000_000, "1" * 1_000_000 + " N", "1" * 1_000_000, "1e" + "9" * 1_000_000 + " N", "1 " + "N" * 1_000_000, "1e9999 N"],
    ids=["an integer", "digits", "digits without unit", "an exponent", "a unit", "an exponent that overflows"],
)
def test_a_quantity_of_a_million_digits_is_refused_at_once_in_a_short_line(value):
    with pytest.raises(SceneError, match="Argument `force` must be") as caught:
        parse(value, "N", "force")
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize(
    ("text", "unit", "same"),
    [
        ("95 RPM", "rad/s", "95 rpm"), ("97 KN", "N", "97 kN"), ("10 KN M", "N m", "10 kN m"), ("2 MIN", "s", "2 min"), ("20 klb", "N", "20 klbf"),
        ("20 lb", "N", "20 lbf"), ("20 lb", "kg", "20 lb"), ("10 tonne-force", "N", "98066.5 N"), ("10 t", "N", "98066.5 N"), ("10 t", "kg", "10000 kg"),
        ("5 tonnes", "N", "5 t"), ("5 tonne", "kg", "5 t"), ("120 1/min", "rad/s", "120 rpm"), ("3 1/min", "1/s", "0.05 1/s"), ("20 ft-lb", "N m", "20 lbf ft"),
        ("\N{MINUS SIGN}5 kN", "N", "-5 kN"), ("7400 ft lb", "N m", "7400 lbf ft"), ("7.4 kft-lbs", "N m", "7400 lbf ft"),
        ("19.5 lbf/ft", "kg/m", "19.5 lb/ft"), ("600 gpm", "m3/s", "600 gal/min"), ("10 bbl/min", "m3/s", "420 gal/min"),
        ("10 bbls/min", "m3/s", "420 gal/min"), ("1 barrel/s", "m3/s", "42 gal/s"),
        *((f"7 {torque}", "N m", "7 lbf ft") for torque in ("lb-ft", "lbf-ft", "ft-lbf", "ft.lb", "lb ft", "ft·lb", "lbft", "ftlbf", "FT-LB", "ft - lb")),
        *((f"7 {torque}", "N m", "7 klbf ft") for torque in ("klb-ft", "kft.lb", "kft-lbf", "KFT-LB", "kftlb", "k ft-lb")),
        *((f"7 {force}", "N", "7 klbf") for force in ("KLB", "Klb", "klbs", "KLBF", "k-lb", "kip", "KIPS")), ("7 LB", "N", "7 lbf"), ("7 T", "N", "7 t"),
        ("210 kg/cm2", "Pa", "210 kgf/cm2"), ("210 kg/cm^2", "Pa", "210 kgf/cm2"), ("210 kg / cm²", "Pa", "210 kgf/cm2"), ("50 lb/in2", "Pa", "50 psi"),
        ("300 cfm", "m3/s", "300 ft3/min"), ("300 CFM", "m3/s", "300 ft3/min"), ("8 bpm", "m3/s", "8 bbl/min"), ("8 BPM", "m3/s", "8 bbl/min"),
        ("600 GPM", "m3/s", "600 gal/min"), ("2200 lpm", "m3/s", "2200 l/min"), ("10 PPG", "kg/m3", "10 lb/gal"),
        ("19.5 PPF", "kg/m", "19.5 lb/ft"), ("19.5 klbm", "kg", "19500 lb"), ("60 FT/HR", "m/s", "60 ft/h"), ("2 HR", "s", "2 h"),
        ("80 c/min", "rad/s", "80 rpm"),
        ("2 KNM", "N m", "2 kN m"), ("40 Nms/rad", "N m s/rad", "40 N m s/rad"),
        ("3 kgm2", "kg m2", "3 kg m2"), ("500 lb-ft/rad", "N m/rad", "500 lbf ft/rad"),
        ("12 N.m", "N m", "12 N m"), ("12 kN . m", "N m", "12 kN m"), ("3 kg.m2", "kg m2", "3 kg m2"), ("3 m2.kg", "kg m2", "3 kg m2"),
        ("7 ft. lb.", "N m", "7 lbf ft"), ("5 in.", "m", "5 in"), ("60 ft./min.", "m/s", "60 ft/min"), ("2 m^0.5.m^1.5", "m2", "2 m2"),
        ("3 Nm2", "N m2", "3 N m2"), ("3 kNms2", "N m s2", "3 kN m s2"),
    ],
)  # fmt: skip
def test_habits_of_drillers_and_letters_of_the_wrong_case_are_understood_where_only_one_unit_fits(text, unit, same):
    assert parse(text, unit) == pytest.approx(parse(same, unit), rel=1e-12)


def test_an_answer_to_a_spelling_of_habit_is_in_the_usual_one():
    assert [parse(text, unit).display_units for text, unit in (("7 lb-ft", "N m"), ("20 KLB", "N"), ("8 bpm", "m3/s"), ('5 7/8"', "m"))] == [
        "lbf ft", "klbf", "bbl/min", "in",
    ]  # fmt: skip


EVERYDAY = {*USUAL, *HABITS.values(), *(word for system in SYSTEMS.values() for pair in system.items() for word in pair)} | {
    *(word for pair in MISTAKEN.items() for word in (pair[0], *pair[1])), "N/m s", "kg/m3", "GPa", "m/s/s", "rad/min", "cm2", "rev/min", "1/s/rad", "kN*m",
}  # fmt: skip


@pytest.mark.parametrize("word", sorted(EVERYDAY))
def test_everyday_units_are_read_without_the_registry_and_as_it_reads_them(word, monkeypatch):
    units._roots.cache_clear()
    with monkeypatch.context() as without:
        without.setattr(units, "_registry", lambda: pytest.fail("asked"))
        found = units._roots(word)
    units._roots.cache_clear()
    monkeypatch.setattr(units, "plain", lambda text: None)
    assert found == units._roots(word)
    units._roots.cache_clear()


@pytest.mark.parametrize("text", ["", "m m/", "furlong", "m**0.5", "s**-1/2", "(N m)/s", "2 m", "/s", "kgm", "* m", "kK", "m 1"])
def test_what_is_no_product_of_everyday_units_is_left_to_the_registry(text):
    assert plain(text) is None


test_wrong_uses_are_refused_in_these_words = refusals(
    *each_of(lambda text, unit: parse(text, unit, "speed"), "1 Hz", [("2 Hz", "rad/s"), ("2 1/s", "rad/s"), ("2 rad/s", "Hz"), ("120 rpm", "Hz"),
     ("2 rad/s", "1/s")]),
    *each_of(lambda text, unit: parse(text, unit), "must be", [("2 rad", "1"), ("0.9 s", "s/rad"), ("0.9 s/m", "s/rad"), ("97 kg", "N"),
     ("1 m", "s"), ("1 N", "1")]),
    *each_of(lambda text: parse(text, "N", "weight"), "`weight`", BROKEN),
    *each_of(lambda value: parse(value, "N", "weight"), "`weight`", [True, False, None, math.nan, math.inf, -math.inf, 10**400, [1.0], {"N": 1},
     b"1 N", 1j, object()]),
    *[(lambda text=text: parse(text, "m", "size"), f"`size` must be .* but `{text}` has no fraction such as the one of `5 7/8 in`")
     for text in ["5 7/0 in", "5 8/7 in", "5.5 7/8 in", "5.5½ in", "1/0 in", "5..2 7/8 in"]],
    *each_of(lambda text, unit: parse(text, unit), "must be", [("5 7/8 in/ft2", "m"), ("5 7/8 kg", "m"), ("5 7/8", "m"), ("5½", "m"),
     ("3 deg/0m", "rad/m"), ("3 deg/30m", "rad"), ("3 m/30m", "1")]),
    *each_of(lambda unit: parse("5 ton", unit, "weight"), "`weight` is `5 ton`, and tons are of three sizes: write `t`", ["kg", "N"]),
    (lambda: parse("30 Mlbf", "N", "weight"), "`weight` is `30 Mlbf`, and M is a thousand to some and a million to others: write k"),
    *each_of(lambda text, unit: parse(text, unit, "weight"), "`weight`", [("20 lb", "Pa"), ("7 lb-ft", "N"), ("20 kg", "N"), ("7 kg m", "N m"),
     ("5 M", "m"), ("5 MG", "kg"), ("5 S", "s"), ('5"', "rad")]),
    *[(lambda text=text: parse(text, "N", "weight"), f"must be in N, but `{text}` is in {given}") for text, given in [("22 ppg", "ppg"),
     ("22 PPG", "PPG"), ('5 7/8"', '"')]],
    # a prefix of the wrong case is refused because milli is not mega
    *each_of(lambda text: parse(text, {"n": "N", "m": "m", "a": "Pa"}[text[-1].lower()]), "", ["1 mn", "5 MM", "7 Mpa", "7 mpa"]),
    *each_of(lambda text: parse(text, "N m"), "has the unknown unit", ["7 ft..lb", "7 ft.2 lb", "7 ft/.lb", "7 .ft lb", "7 ft...", "7 acre..in"]),
)  # fmt: skip
