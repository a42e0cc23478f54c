"""Strings from tables against closed forms: minimum curvature, soft-string side force, frequencies of stepped shafts, and what lumping must keep."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.optimize import brentq

from controllers import PI
from models import (
    BitRock,
    Coulomb,
    DrillString,
    Section,
    StepFriction,
    Survey,
    ToolJoint,
    TorsionalChain,
    inner_diameter,
    read_sections,
    shaft_frequencies,
    wells,
)
from models.shaft import chain_frequencies
from models.soft_string import side_force, tension
from studies.questions import detail
from toolbox import Scene, SceneError, compose, energy_audit, measure, simulate

TABLES = Path(__file__).parents[2] / "models" / "tables"
G = 9.80665
PIPE, COLLAR = Section(2000.0, 0.127, 0.1086), Section(300.0, 0.1651, 0.0714)


def total(sections, value):
    return sum(section.length * value(section) for section in sections)


def test_numbers_of_a_string_may_be_typed_with_units_and_be_those_of_numpy():
    typed = DrillString.from_tables([PIPE], top_inertia="2 t m2", bit_drag="0.06 kN m s/rad", elements=np.int64(5))
    assert typed == DrillString.from_tables([PIPE], top_inertia=np.float64(2000.0), bit_drag=60, elements=5)
    with pytest.raises(SceneError, match="`band` must be a finite number > 0 Hz, but it is None"):
        DrillString.from_tables([PIPE], top_inertia=1.0, band=None)  # type: ignore[arg-type]
    with pytest.raises(SceneError, match="`elements` must be an integer >= 1 and <= 10000, but it is True"):
        DrillString.from_tables([PIPE], top_inertia=1.0, elements=True)


# --- pipe as catalogues have it

INCH, PPF = 0.0254, 0.45359237 / 0.3048

PLAIN_END = {  # weight of the tube alone [lb/ft] in the tables of API Specification 5DP, by size and nominal weight
    (2.375, 4.85): 4.43, (2.375, 6.65): 6.26, (2.875, 6.85): 6.16, (2.875, 10.40): 9.72, (3.5, 9.50): 8.81, (3.5, 13.30): 12.31, (3.5, 15.50): 14.63,
    (4.0, 11.85): 10.46, (4.0, 14.00): 12.93, (4.0, 15.70): 14.69, (4.5, 13.75): 12.24, (4.5, 16.60): 14.98, (4.5, 20.00): 18.69, (5.0, 16.25): 14.87,
    (5.0, 19.50): 17.93, (5.0, 25.60): 24.03, (5.5, 19.20): 16.87, (5.5, 21.90): 19.81, (5.5, 24.70): 22.54, (6.625, 25.20): 22.19, (6.625, 27.70): 24.21,
}  # fmt: skip


@pytest.mark.parametrize(("outer", "nominal"), PLAIN_END)
def test_the_inner_diameter_of_a_nominal_weight_gives_the_plain_end_weight_of_the_tables(outer, nominal):
    inner = inner_diameter(f"{outer} in", f"{nominal} ppf")
    tube = Section("1 ft", f"{outer} in", inner)
    assert tube.weight() / G / PPF == pytest.approx(PLAIN_END[outer, nominal], rel=2.5e-3)  # the tables take 7833 to 7850 kg/m3


def test_five_inch_pipe_has_the_numbers_of_its_data_sheet():
    """Data sheet of 5 in 19.50 lb/ft S-135 with NC50 6.625 x 3.25 in: Workstrings International (2011)."""
    pipe = Section("5000 ft", "5 in", inner_diameter("127 mm", "29 kg/m"))
    assert pipe.length == pytest.approx(1524.0) and pipe.inner == pytest.approx(4.276 * INCH)
    assert pipe.area / INCH**2 == pytest.approx(5.275, abs=5e-4)
    assert pipe.polar_moment / (pipe.outer / 2) / INCH**3 == pytest.approx(11.415, abs=5e-4)  # polar section modulus
    joint = ToolJoint("6.625 in", "3.25 in", "21 in", every="31.7 ft")
    string = dataclasses.replace(pipe, tool_joint=joint)
    tube, upset = 17.932, math.pi / 4 * (6.625**2 - 3.25**2) * 7850.0 * INCH**2 / PPF
    by_hand = (tube * (31.7 - 1.75) + upset * 1.75) / 31.7
    assert string.weight() / G / PPF == pytest.approx(by_hand, rel=3e-3)
    assert by_hand < 23.52 < 1.08 * by_hand  # the data sheet counts upsets and tapers, too
    hung = dataclasses.replace(string, mass_per_length="23.52 ppf")
    assert hung.weight() / G / PPF == pytest.approx(23.52) and hung.weight(1200.0) == pytest.approx(hung.weight() * (1 - 1200 / 7850))
    assert (
        hung.inertia_per_length / string.inertia_per_length == pytest.approx(23.52 / (string.weight() / G / PPF))
        and hung.torsional_rigidity == string.torsional_rigidity
    )
    assert string.contact_radius == pytest.approx(6.625 * INCH / 2) and pipe.contact_radius == pytest.approx(2.5 * INCH)


def test_a_string_with_tool_joints_swings_as_one_whose_joints_are_sections_of_their_own():
    joint = ToolJoint("6.625 in", "3.25 in", "21 in", every="31.7 ft")
    pipe = Section(200 * joint.every, "5 in", "4.276 in", tool_joint=joint)
    piece, upset = Section(joint.every - joint.length, 0.127, pipe.inner), Section(joint.length, joint.outer, joint.inner)
    apart = [piece, upset] * 200
    for value in ("area", "inertia_per_length"):
        assert pipe.length * getattr(pipe, value) == pytest.approx(total(apart, lambda s, value=value: getattr(s, value)), rel=1e-12)
    assert pipe.length / pipe.torsional_rigidity == pytest.approx(total(apart, lambda s: 1 / s.torsional_rigidity), rel=1e-12)
    exact = shaft_frequencies(apart, 4, top_inertia=math.inf)
    np.testing.assert_allclose(shaft_frequencies([pipe], 4, top_inertia=math.inf), exact, rtol=2e-3)
    plain = shaft_frequencies([dataclasses.replace(pipe, tool_joint=None)], 4, top_inertia=math.inf)
    assert (abs(plain / exact - 1) > 0.02).all()  # joints left out are seen
    lumped = DrillString.from_tables([pipe], top_inertia=1e12, elements=40)
    np.testing.assert_allclose(chain_frequencies(lumped.inertia, lumped.stiffness)[:4], exact, rtol=1e-2)


def test_a_table_may_have_the_columns_of_a_tally(tmp_path):
    table = tmp_path / "string.csv"
    table.write_text(
        "name,length [ft],OD [in],nominal weight [lb/ft],weight [ppf],tool joint OD [in],tool joint ID [in],tool joint length [in],joint length [ft],material\n"
        "pipe,5000,5,19.5,23.52,6.625,3.25,21,31.7,steel\n"
        "pipe,1000,4.5,16.6,,,,,,steel\n"
    )
    first, second = read_sections(table)
    joint = ToolJoint("6.625 in", "3.25 in", "21 in", every="31.7 ft")
    whole = Section("5000 ft", "5 in", "4.276 in", mass_per_length="23.52 lb/ft", tool_joint=joint)
    assert first.inertia_per_length == pytest.approx(whole.inertia_per_length, rel=1e-12) and first.torsional_rigidity == pytest.approx(
        whole.torsional_rigidity, rel=1e-12
    )
    assert second.mass_per_length is None and second.tool_joint is None and second.inner == pytest.approx(3.826 * INCH)
    for old, new, word in (
        (",31.7,steel", ",,steel", "column `joint length .ft.`: a row with a tool joint must have"),
        (",19.5,", ",18.5,", "row 1 .*must be that of an API drill pipe of 5 in, in lb/ft 16.25, 19.5, 25.6, but it is 18.5"),
        (",19.5,", ",,", "either `ID` or `nominal weight`"),
        (",6.625,3.25", ",3.25,6.625", "`inner` must be > 0 m and < 0.08255 m|must be"),
        ("[ppf]", "[psi]", "must be in kg/m"),
    ):
        bad = tmp_path / "bad.csv"
        bad.write_text(table.read_text().replace(old, new, 1))
        with pytest.raises(SceneError, match=word):
            read_sections(bad)


def test_a_survey_may_be_typed_in_degrees_and_feet():
    typed = Survey(("0 ft", "1000 ft", "2000 ft"), ("0 deg", "0 deg", "60 deg"), (0.0, "90 deg", "90 deg"))
    assert typed.depth == pytest.approx((0.0, 304.8, 609.6)) and typed.inclination[2] == pytest.approx(math.pi / 3)
    with pytest.raises(SceneError, match="must be in rad"):
        Survey((0.0, 1.0), ("0 m", 0.0), (0.0, 0.0))
    with pytest.raises(SceneError, match="`outer` of Section.*must be > 0 m|`outer`"):
        Section("1 ft", "-5 in", 0.0)
    with pytest.raises(SceneError, match="must be a ToolJoint"):
        Section(1.0, 0.1, 0.05, tool_joint="6 in")


# --- survey


def arc(radius, angle, azimuth=0.0, stations=2):
    """A hole that turns from the vertical by `angle` on a circle, then goes straight."""
    inclination = np.linspace(0.0, angle, stations)
    depth = radius * inclination
    return Survey((*depth, depth[-1] + 1000.0), (*inclination, angle), (azimuth,) * (stations + 1))


@pytest.mark.parametrize("stations", [2, 5])
@pytest.mark.parametrize("azimuth", [0.0, 2.0])
def test_minimum_curvature_follows_a_circle_exactly(stations, azimuth):
    # down = R sin, away = R (1 - cos), whatever the stations on the circle
    radius = 400.0
    survey = arc(radius, 1.2, azimuth, stations)
    turned = np.linspace(0.0, 1.2, 37)
    s = radius * turned
    away = radius * (1 - np.cos(turned))
    expected = np.column_stack([away * math.cos(azimuth), away * math.sin(azimuth), radius * np.sin(turned)])
    np.testing.assert_allclose(survey.position(s), expected, atol=1e-10)
    np.testing.assert_allclose(survey.inclination_at(s), turned, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(survey.curvature(s[:-1]), axis=1), 1 / radius, rtol=1e-12)
    beyond = survey.position(np.array([s[-1] + 100.0]))[0]
    assert beyond[2] == pytest.approx(radius * math.sin(1.2) + 100.0 * math.cos(1.2))
    assert np.hypot(beyond[0], beyond[1]) == pytest.approx(away[-1] + 100.0 * math.sin(1.2))


def test_a_turn_at_constant_inclination_is_an_arc_of_a_great_circle():
    # between stations the hole turns about one axis, by the angle between both tangents: cos b = cos^2 i + sin^2 i cos(turn)
    survey = Survey((0.0, 300.0), (1.0, 1.0), (0.0, 0.8))
    angle = math.acos(math.cos(1.0) ** 2 + math.sin(1.0) ** 2 * math.cos(0.8))
    s = np.linspace(0.0, 300.0, 11)
    t = survey.tangent(s)
    np.testing.assert_allclose(np.linalg.norm(t, axis=1), 1.0, rtol=1e-14)
    np.testing.assert_allclose(t @ t[0], np.cos(angle * s / 300.0), atol=1e-14)
    # position is the integral of the tangent
    for axis in range(3):
        reached = quad(lambda x, axis=axis: survey.tangent(np.array([x]))[0, axis], 0.0, 170.0, epsabs=1e-11)[0]
        assert survey.position(np.array([170.0]))[0, axis] == pytest.approx(reached, abs=1e-9)


@given(st.lists(st.tuples(st.floats(1.0, 500.0), st.floats(0.0, 2.0), st.floats(-3.0, 3.0)), min_size=2, max_size=6))
def test_curvature_is_the_derivative_of_the_tangent_and_that_of_the_position(stations):
    steps, inclination, azimuth = (np.array(values) for values in zip(*stations, strict=True))
    survey = Survey(tuple(np.cumsum(steps) - steps[0]), tuple(inclination), tuple(azimuth))
    middle = (np.array(survey.depth[:-1]) + np.array(survey.depth[1:])) / 2
    h = 1e-3 * np.diff(survey.depth)
    slope = (survey.tangent(middle + h) - survey.tangent(middle - h)) / (2 * h[:, None])
    np.testing.assert_allclose(slope, survey.curvature(middle), rtol=1e-5, atol=1e-9)
    slope = (survey.position(middle + h) - survey.position(middle - h)) / (2 * h[:, None])
    np.testing.assert_allclose(slope, survey.tangent(middle), rtol=1e-5, atol=1e-5)


# --- soft string


def test_in_a_straight_inclined_well_the_side_force_is_the_weight_across_the_hole():
    inclination, mud = 0.9, 1200.0
    hole = Survey((0.0, 3000.0), (inclination,) * 2, (0.3,) * 2)
    s = np.array([10.0, 1500.0, 2100.0])
    weights = np.array([(7850.0 - mud) * G * section.area for section in (PIPE, PIPE, COLLAR)])
    for doglegs in (False, True):  # no curvature, so that the tension has no part in it
        force = side_force([PIPE, COLLAR], hole, s, mud_density=mud, weight_on_bit=5e4, doglegs=doglegs)
        np.testing.assert_allclose(force, weights * math.sin(inclination), rtol=1e-12)
    pull = tension([PIPE, COLLAR], hole, s, mud_density=mud, weight_on_bit=5e4)
    below = np.array([1990.0 * weights[0] + 300.0 * weights[2], 500.0 * weights[0] + 300.0 * weights[2], 200.0 * weights[2]])
    np.testing.assert_allclose(pull, below * math.cos(inclination) - 5e4, rtol=1e-12)


def test_on_a_circular_arc_tension_adds_to_the_side_force_as_johancsik_says():
    # T(th) = w R (sin th_e - sin th) - W,  side force |T / R - w sin th|: the tension lifts the string off the low side of a building hole
    radius, weight_on_bit = 300.0, 2e4
    pipe = dataclasses.replace(PIPE, length=radius * 1.3)
    hole = arc(radius, 1.3)
    turned = np.linspace(0.01, 1.29, 20)
    w = 7850.0 * G * pipe.area
    pull = w * radius * (math.sin(1.3) - np.sin(turned)) - weight_on_bit
    np.testing.assert_allclose(tension([pipe], hole, radius * turned, weight_on_bit=weight_on_bit), pull, rtol=1e-10)
    force = side_force([pipe], hole, radius * turned, weight_on_bit=weight_on_bit)
    np.testing.assert_allclose(force, np.abs(pull / radius - w * np.sin(turned)), rtol=1e-9)
    # without doglegs
    np.testing.assert_allclose(side_force([pipe], hole, radius * turned, doglegs=False), w * np.sin(turned), rtol=1e-12)


def test_in_a_flat_turn_the_tension_pulls_square_to_the_weight():
    # at 90 deg inclination the hole curves in the horizontal plane and T is constant: side force sqrt((T / R)^2 + w^2)
    hole = Survey((0.0, 500.0, 1000.0), (math.pi / 2,) * 3, (0.0, 0.5, 1.0))
    pipe = dataclasses.replace(PIPE, length=1000.0)
    w = 7850.0 * G * pipe.area
    force = side_force([pipe], hole, np.array([100.0, 800.0]), weight_on_bit=-3e5)
    np.testing.assert_allclose(force, math.hypot(3e5 * 1e-3, w), rtol=1e-9)


# --- frequencies of shafts


@pytest.mark.parametrize(("top", "bit", "numbers"), [(0.0, 0.0, [1, 2, 3]), (math.inf, 0.0, [0.5, 1.5, 2.5]), (0.0, math.inf, [0.5, 1.5, 2.5]),
                                                     (math.inf, math.inf, [1, 2, 3])])  # fmt: skip
def test_a_uniform_shaft_has_the_textbook_frequencies(top, bit, numbers):
    # f = n c / 2 L, n = 1, 2, ... with equal ends and 1/2, 3/2, ... with unequal ones; cut into sections it stays the same shaft
    for cut in ([PIPE], [dataclasses.replace(PIPE, length=length) for length in (300.0, 1500.0, 200.0)]):
        found = shaft_frequencies(cut, 3, top_inertia=top, bit_inertia=bit)
        np.testing.assert_allclose(found, np.array(numbers) * PIPE.wave_speed / (2 * PIPE.length), rtol=1e-12)


@pytest.mark.parametrize("inertia", [10.0, 1000.0])
def test_a_shaft_with_a_disk_obeys_its_transcendental_equation(inertia):
    # top held, disk below: (w L / c) tan(w L / c) = I_shaft / I_disk
    ratio = PIPE.inertia_per_length * PIPE.length / inertia
    roots = [brentq(lambda x: x * math.sin(x) - ratio * math.cos(x), n * math.pi, (n + 0.5) * math.pi) for n in range(4)]
    found = shaft_frequencies([PIPE], 4, top_inertia=math.inf, bit_inertia=inertia)
    np.testing.assert_allclose(2 * math.pi * found * PIPE.length / PIPE.wave_speed, roots, rtol=1e-11)


def test_a_shaft_of_two_sections_obeys_its_transcendental_equation():
    # held, free: zeta_1 cos(a) cos(b) = zeta_2 sin(a) sin(b), a and b the phases w L / c
    def equation(f):
        a, b = (2 * math.pi * f * section.length / section.wave_speed for section in (PIPE, COLLAR))
        return PIPE.impedance * math.cos(a) * math.cos(b) - COLLAR.impedance * math.sin(a) * math.sin(b)

    grid = np.linspace(1e-6, 6.0, 4001)
    values = [equation(f) for f in grid]
    roots = [brentq(equation, a, b) for a, b, u, v in zip(grid, grid[1:], values, values[1:], strict=False) if u * v < 0]
    assert len(roots) > 8
    np.testing.assert_allclose(shaft_frequencies([PIPE, COLLAR], len(roots), top_inertia=math.inf), roots, rtol=1e-9)


def test_a_shaft_between_heavy_disks_swings_as_two_inertias_on_a_spring():
    # light shaft: w^2 = k (1 / J1 + 1 / J2)
    found = shaft_frequencies([PIPE, COLLAR], 1, top_inertia=3e7, bit_inertia=2e7)[0]
    stiffness = 1 / (PIPE.length / PIPE.torsional_rigidity + COLLAR.length / COLLAR.torsional_rigidity)
    assert 2 * math.pi * found == pytest.approx(math.sqrt(stiffness * (1 / 3e7 + 1 / 2e7)), rel=1e-4)


def test_a_chain_of_equal_inertias_has_the_textbook_frequencies():
    # free: w_j = 2 sqrt(k / J) sin(j pi / 2 n)
    n = 7
    expected = 2 * math.sqrt(800.0 / 2.0) * np.sin(np.arange(1, n) * math.pi / (2 * n)) / (2 * math.pi)
    np.testing.assert_allclose(chain_frequencies((2.0,) * n, (800.0,) * (n - 1)), expected, rtol=1e-12)
    # one end held: two inertias, one turns
    np.testing.assert_allclose(chain_frequencies((9.0, 2.0), (800.0,), top_held=True), [20.0 / (2 * math.pi)], rtol=1e-12)
    np.testing.assert_allclose(chain_frequencies((2.0, 9.0), (800.0,), bit_held=True), [20.0 / (2 * math.pi)], rtol=1e-12)


# --- lumping

sections = st.builds(
    lambda logarithm, outer, ratio, light: Section(10**logarithm, outer, ratio * outer, *((2780.0, 27e9) if light else ())),
    st.floats(0.0, 3.3), st.floats(0.06, 0.4), st.floats(0.0, 0.93), st.booleans(),
)  # fmt: skip
strings = st.lists(sections, min_size=1, max_size=8)


@given(strings, st.integers(1, 60))
def test_lumping_keeps_total_inertia_and_total_compliance(string, elements):
    chain = DrillString.from_tables(string, top_inertia=100.0, bit_inertia=7.0, elements=elements)
    assert len(chain.stiffness) == elements
    assert sum(chain.inertia) == pytest.approx(107.0 + total(string, lambda s: s.inertia_per_length), rel=1e-12)
    assert sum(1 / k for k in chain.stiffness) == pytest.approx(total(string, lambda s: 1 / s.torsional_rigidity), rel=1e-12)
    assert all(a < b for a, b in zip(chain.depth, chain.depth[1:], strict=False))
    assert chain.depth[0] == 0.0 and chain.depth[-1] == pytest.approx(sum(s.length for s in string), rel=1e-12)


@given(strings, st.floats(0.0, 4.0), st.one_of(st.just(0.0), st.floats(1.0, 1000.0), st.just(math.inf)), st.floats(0.3, 5.0))
def test_natural_frequencies_within_the_band_are_right_within_one_per_cent(string, top, bit, waves):
    # the stated rule, on strings nobody chose
    travel = total(string, lambda s: 1 / s.wave_speed)
    band, held = waves / travel, math.isinf(bit)
    chain = DrillString.from_tables(string, top_inertia=10**top, bit_inertia=0.0 if held else bit, band=band)
    exact = shaft_frequencies(string, 20, top_inertia=10**top, bit_inertia=bit)
    exact = exact[exact <= band]
    lumped = chain_frequencies(chain.inertia, chain.stiffness, bit_held=held)[: len(exact)]
    assert len(lumped) == len(exact)
    np.testing.assert_allclose(lumped, exact, rtol=0.01)


def test_the_error_of_a_uniform_shaft_is_what_the_rule_says_and_falls_with_the_square_of_the_elements():
    # relative error -(w h / c)^2 / 24, w h / c = pi / elements for the first frequency of a free shaft
    exact = shaft_frequencies([PIPE], 1)[0]
    for elements in (8, 32, 128):
        chain = DrillString.from_tables([PIPE], top_inertia=0.0, elements=elements)
        error = chain_frequencies(chain.inertia, chain.stiffness)[0] / exact - 1
        assert error == pytest.approx(-((math.pi / elements) ** 2) / 24, rel=0.02)


def test_twice_the_band_takes_twice_the_elements_of_a_long_string():
    counts = [len(DrillString.from_tables([PIPE], top_inertia=0.0, band=band).stiffness) for band in (5.0, 10.0)]
    # the rule: h = 0.35 c / (2 pi band)
    assert counts == [math.ceil(PIPE.length * 2 * math.pi * band / (0.35 * PIPE.wave_speed)) for band in (5.0, 10.0)]


def test_short_sections_do_not_cost_elements_of_their_own():
    # a tally with a joint every ten metres, band 1 Hz: elements stay some 150 m long
    tally = [Section(9.1, 0.127, 0.1086), Section(0.4, 0.168, 0.095)] * 200
    chain = DrillString.from_tables(tally, top_inertia=2000.0, band=1.0)
    assert len(chain.stiffness) < 20
    exact = shaft_frequencies(tally, 2, top_inertia=2000.0)
    np.testing.assert_allclose(chain_frequencies(chain.inertia, chain.stiffness)[:2], exact, rtol=0.01)


# --- friction and drag along the string


def bent_hole(depth=2300.0):
    return Survey((0.0, 800.0, 1500.0, depth), (0.0, 0.0, 1.0, 1.0), (0.0, 0.0, 0.4, 0.4))


@given(st.integers(1, 40), st.booleans(), st.booleans())
@settings(max_examples=20)
def test_friction_loads_add_up_to_the_integral_of_side_force_times_radius(elements, doglegs, on_bottom):
    string, hole, mud = [PIPE, COLLAR], bent_hole(), 1300.0
    chain = DrillString.from_tables(string, hole, top_inertia=2000.0, elements=elements, friction=Coulomb(), mud_density=mud, doglegs=doglegs,
                                    on_bottom=on_bottom)  # fmt: skip

    def torque(s):
        section = string[0] if s < 2000.0 else string[1]
        return side_force(string, hole, np.array([s]), mud_density=mud, doglegs=doglegs)[0] * section.outer / 2

    whole = sum(quad(torque, a, b, epsrel=1e-10)[0] for a, b in ((800.0, 1500.0), (1500.0, 2000.0), (2000.0, 2300.0)))
    assert sum(chain.friction_load) == pytest.approx(whole, rel=1e-5)  # loads below a millionth of the whole are left out
    assert (elements in chain.friction_at) is not on_bottom


def test_an_inertia_without_side_force_has_no_contact():
    chain = DrillString.from_tables([PIPE, COLLAR], bent_hole(), top_inertia=2000.0, elements=23, friction=Coulomb())
    depth = np.array(chain.depth)
    first = chain.friction_at[0]
    assert depth[first + 1] > 800.0 >= depth[first - 1]
    assert chain.friction_at == tuple(range(first, 24))
    assert [element.name for element in compose(chain).elements] == [f"chain.{i}" for i in range(first, 24)]


def test_a_string_on_bottom_leaves_its_last_inertia_to_the_rock():
    chain = DrillString.from_tables([PIPE, COLLAR], bent_hole(), top_inertia=2000.0, elements=10, friction=Coulomb(), on_bottom=True)
    plant = compose(chain, BitRock(weight=50_000.0))
    assert [element.name for element in plant.elements][-1] == "bit"
    assert "chain.10" not in [element.name for element in plant.elements]


def test_drag_along_the_string_slows_it_at_its_rate_and_the_energy_is_accounted_for():
    # no top drive, no friction: every inertia loses speed as exp(-rate t)
    chain = DrillString.from_tables([PIPE], top_inertia=0.0, elements=6, drag_rate=0.3)
    run = simulate(compose(chain), 5.0, start={"chain.speed": (2.0,) * 7}, accuracy=1e-10)
    np.testing.assert_allclose(run.at(5.0)["chain.speed"], 2.0 * math.exp(-1.5), rtol=1e-9)
    audit = energy_audit(run)
    assert audit.relative < 1e-9
    assert audit.losses["chain.drag"] == pytest.approx(0.5 * sum(chain.inertia) * 4.0 * (1 - math.exp(-3.0)), rel=1e-9)


def test_drag_at_the_ends_adds_to_that_along_the_string():
    string = {"inertia": (5.0, 3.0), "stiffness": (100.0,), "damping": (1.0,)}
    once = TorsionalChain(**string, top_drag=2.0, bit_drag=1.5)
    split = TorsionalChain(**string, top_drag=1.5, drag=(0.5, 1.5))
    ends = [simulate(compose(chain), 3.0, inputs={"top.torque": 10.0}).at(3.0)["chain.speed"] for chain in (once, split)]
    np.testing.assert_allclose(*ends, rtol=1e-12)


def test_internal_damping_is_proportional_to_stiffness():
    chain = DrillString.from_tables([PIPE, COLLAR], top_inertia=10.0, elements=5, internal_damping=0.06)
    np.testing.assert_allclose(chain.damping, 0.06 * np.array(chain.stiffness), rtol=1e-15)
    assert DrillString.from_tables([PIPE], top_inertia=10.0).damping[0] == 0.0


def test_the_energy_of_a_string_with_friction_along_it_is_accounted_for():
    run = simulate(compose(wells.AARSNES_SHOR), 12.0, controller=PI(38e3, 100e3, 2 * math.pi), accuracy=1e-9)
    assert len(run.events) > 20
    assert energy_audit(run).relative < 1e-8


@pytest.mark.parametrize(
    ("sections", "count", "ends", "word"),
    [
        ([], 1, {}, "sections"),
        ([PIPE], -1, {}, "count"),
        ([PIPE], 1.5, {}, "count"),
        ([PIPE], 1, {"top_inertia": -1.0}, "top_inertia"),
        ([PIPE], 1, {"bit_inertia": math.nan}, "bit_inertia"),
    ],
)
def test_frequencies_of_a_shaft_that_cannot_be_are_refused_by_name(sections, count, ends, word):
    with pytest.raises(SceneError, match=f"Argument `{word}`"):
        shaft_frequencies(sections, count, **ends)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"band": 0.0}, "band"),
        ({"band": math.nan}, "band"),
        ({"band": 1e6}, "band"),
        ({"elements": 0}, "elements"),
        ({"elements": 2.0}, "elements"),
        ({"elements": True}, "elements"),
        ({"top_inertia": -1.0}, "top_inertia"),
        ({"bit_inertia": math.inf}, "bit_inertia"),
        ({"mud_density": -1.0}, "mud_density"),
        ({"mud_density": 8000.0}, "mud_density"),
        ({"drag_rate": "0.1"}, "drag_rate"),
        ({"weight_on_bit": 1e4}, "weight_on_bit"),
        ({"survey": None}, "survey"),
        ({"survey": Survey((0.0, 2299.0), (0.1, 0.1), (0.0, 0.0))}, "survey"),
        ({"survey": Survey((0.0, 2300.0), (0.0, 0.0), (0.0, 0.0))}, "friction"),
        ({"survey": 7}, "survey"),
        ({"sections": []}, "sections"),
        ({"sections": [PIPE, 3]}, "sections"),
        ({"sections": 3}, "sections"),
    ],
)
def test_a_string_that_cannot_be_made_is_refused_by_name(change, word):
    arguments = {"sections": [PIPE, COLLAR], "survey": bent_hole(), "top_inertia": 2000.0, "friction": Coulomb()} | change
    with pytest.raises(SceneError, match=f"Argument `{word}`"):
        DrillString.from_tables(**arguments)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"friction_at": (0, 0)}, "friction_at"),
        ({"friction_at": (1, 0)}, "friction_at"),
        ({"friction_at": (0, 3)}, "friction_at"),
        ({"friction_at": (0,)}, "friction_load"),
        ({"friction_at": (0, 2), "friction": None, "friction_load": None}, "friction_at"),
        ({"drag": (1.0, 1.0)}, "drag"),
        ({"drag": (1.0, 1.0, -1.0)}, "drag"),
        ({"depth": (0.0, 1.0)}, "depth"),
    ],
)
def test_a_chain_whose_fields_contradict_each_other_is_refused(change, word):
    chain = {"inertia": (1.0,) * 3, "stiffness": (1.0,) * 2, "damping": (0.0,) * 2, "friction": Coulomb(), "friction_load": (1.0, 1.0)}
    with pytest.raises(SceneError, match=rf"chain\.{word}"):
        compose(DrillString(**(chain | change)))


# --- dry friction along the string: published wells

RPM = math.pi / 30


def break_off():
    """int mu rho g A r_o sin(inc) dx of the well of Aarsnes and Shor by hand: an arc of 600 m to 60 deg, then 400 m straight, collars at the end."""
    pipe, *collars = read_sections(TABLES / "aarsnes_shor_sections.csv")
    weight = [0.3 * section.weight() * section.outer / 2 for section in (pipe, *collars)]
    along_arc = 600.0 / (math.pi / 3) * (1 - math.cos(math.pi / 3))
    straight = [2500.0 - 2100.0 - sum(collar.length for collar in collars), *(collar.length for collar in collars)]
    return weight[0] * along_arc + math.sin(math.pi / 3) * sum(w * length for w, length in zip(weight, straight, strict=True))


def test_a_string_turned_slowly_needs_its_break_off_torque():
    # at 0.1 rad/s, far below the drop at 1.5 rad/s, every contact has its static friction but for 2e-5 of it; besides there is the drag
    well = wells.AARSNES_SHOR
    assert 0.3 * sum(well.friction_load) == pytest.approx(break_off(), rel=1e-6)
    assert break_off() == pytest.approx(10_247.0, abs=1.0)
    run = simulate(compose(well), 500.0, controller=PI(2e3, 5.54e3, 0.1))
    np.testing.assert_allclose(run.at(500.0)["chain.speed"], 0.1, rtol=1e-4)
    assert run.at(500.0)["top.load"] == pytest.approx(break_off() + 0.1 * sum(well.drag[1:]), rel=1e-4)
    # the bit is the last to move, when the top carries all of it but for the slow waves that each contact sends when it lets go
    release = next(event.time for event in run.events if event.element == "chain.33")
    assert run.at(release)["top.load"] == pytest.approx(break_off(), rel=0.01)


def released(elements):
    """A uniform string in a straight inclined hole under a top that does not turn, wound up until every contact lets go; its run and its break-off torque."""
    hole = Survey((0.0, 2000.0), (1.0, 1.0), (0.0, 0.0))
    chain = DrillString.from_tables([PIPE], hole, top_inertia=1e12, elements=elements, friction=Coulomb(static=0.3, kinetic=0.195))
    load = 0.3 * np.array(chain.friction_load)
    below = np.cumsum(load[::-1])[::-1]
    twist = below[1:] / np.array(chain.stiffness) * (1 + 1e-9)
    return simulate(compose(chain), 4.0, start={"chain.twist": twist}), below[0]


def test_torque_swings_by_twice_the_drop_and_the_slip_lasts_half_the_fundamental_period():
    # when friction drops from T to r T everywhere, the wave equation of a uniform string returns the deviation (1 - r) T with the other sign after
    # 2 L / c, and there it stands still: swing 2 (1 - r) T, slip for half the period of the shaft with its top held
    half = 0.5 / shaft_frequencies([PIPE], 1, top_inertia=math.inf)[0]
    assert half == pytest.approx(2 * PIPE.length / PIPE.wave_speed, rel=1e-12)
    for elements, error in ((20, 0.02), (80, 0.005)):
        run, torque = released(elements)
        extent = measure.extent(run, "top.load")
        swing = extent.maximum - extent.minimum
        # the top, which does not turn, keeps the share of half an element
        assert swing == pytest.approx(2 * 0.35 * torque, rel=error + 0.5 / elements)
        first = run.intervals(f"chain.{elements}")[:2]
        assert [mode for *_, mode in first] == ["slip+", "stick"]
        assert first[0][1] == pytest.approx(half, rel=error / 10)
        assert first[1][1] == 4.0


def test_off_bottom_at_60_rpm_the_published_drive_keeps_the_string_in_stick_slip_and_a_softer_one_frees_it():
    # the published behaviour: stick-slip without any bit torque, its period somewhat above the fundamental one of the string under a held top
    plant = compose(wells.AARSNES_SHOR)
    stiff = simulate(plant, 60.0, controller=PI(38e3, 100e3, 60 * RPM))
    assert 0.15 < measure.stuck_ratio(stiff, "chain.33", 20.0) < 0.45
    assert measure.severity(stiff, "bit.speed", after=20.0) > 1.0
    fundamental = 1 / shaft_frequencies(read_sections(TABLES / "aarsnes_shor_sections.csv"), 1, top_inertia=math.inf)[0]
    assert fundamental == pytest.approx(4.43, abs=0.01)
    assert 1.0 < detail.period(stiff, "chain.33", 60 * RPM, 20.0) / fundamental < 1.2
    extent = measure.extent(stiff, "top.load", 20.0)
    assert extent.maximum - extent.minimum > 2 * 0.35 * break_off()  # the swing at standstill, and the wave of the drive on top of it
    soft = simulate(plant, 60.0, controller=PI(2e3, 5.54e3, 60 * RPM))
    assert measure.stuck_ratio(soft, "chain.33", 20.0) == 0.0
    fast = simulate(plant, 60.0, controller=PI(38e3, 100e3, 200 * RPM))
    assert measure.stuck_ratio(fast, "chain.33", 20.0) == 0.0


def lumped(elements, duration):
    """A run of the well of Aarsnes and Shor in so many elements under its published drive from rest, and when its bit first moves."""
    folder = [TABLES / f"aarsnes_shor_{name}.csv" for name in ("sections", "survey")]
    string = DrillString.from_tables(*folder, top_inertia=2900.0, drag_rate=0.1, friction=StepFriction(), elements=elements)
    if elements == len(wells.AARSNES_SHOR.stiffness):
        assert string == wells.AARSNES_SHOR
    run = simulate(compose(string), duration, controller=PI(38e3, 100e3, 60 * RPM))
    return run, next(event.time for event in run.events if event.element == f"chain.{elements}")


@pytest.mark.slow
def test_first_motion_period_and_largest_torque_of_the_inclined_well_change_by_less_than_five_per_cent_with_twice_as_many_elements():
    found = []
    for elements in (33, 66):
        run, first = lumped(elements, 120.0)
        found.append((first, detail.period(run, f"chain.{elements}", 60 * RPM, 20.0), measure.extent(run, "top.load", 0.0).maximum))
    np.testing.assert_allclose(*found, rtol=0.05)


def test_a_string_that_is_right_up_to_one_hertz_alone_moves_its_bit_too_early():
    coarse, fine = lumped(17, 4.0)[1], lumped(33, 4.0)[1]
    assert coarse < 1.2 and fine > 2.5


def test_the_string_of_the_ufrj_swings_like_its_published_lumped_model():
    # published: I = I_pipe / 3 + I_BHA on k = G J / L_p under a top that turns as told; the shaft has its bottom-hole assembly as elastic sections too
    pipe, *bha = read_sections(TABLES / "ufrj_sections.csv")
    inertia = pipe.inertia_per_length * pipe.length / 3 + total(bha, lambda s: s.inertia_per_length)
    published = math.sqrt(pipe.torsional_rigidity / pipe.length / inertia) / (2 * math.pi)
    exact = shaft_frequencies([pipe, *bha], 1, top_inertia=math.inf)[0]
    assert exact == pytest.approx(published, rel=0.03)
    well = wells.UFRJ
    assert chain_frequencies(well.inertia, well.stiffness, top_held=True)[0] == pytest.approx(exact, rel=2e-3)
    np.testing.assert_allclose(well.damping, 0.06 * np.array(well.stiffness), rtol=1e-14)
    assert sum(well.drag) == pytest.approx(0.35 * total([pipe, *bha], lambda s: s.inertia_per_length), rel=1e-12)


def test_two_elements_overstate_the_speed_that_ends_stick_slip_and_understate_the_swing_of_the_torque():
    # the answers of studies/questions/detail.py; what more elements would change in the chain of ten is in its table
    coarse, fine = detail.answers(2), detail.answers(10)
    assert coarse.band == 0.0 and fine.band > 0.5
    assert coarse.period == pytest.approx(fine.period, rel=0.06)
    assert coarse.severity < 0.9 * fine.severity
    assert coarse.swing < 0.75 * fine.swing
    assert coarse.free_from >= fine.free_from + 20.0


# --- scenes


def test_a_scene_names_tables_relative_to_itself_and_is_saved_with_every_number(root, tmp_path):
    scene = Scene.load(root / "studies" / "scenes" / "aarsnes_shor.toml")
    assert scene.parts == (wells.AARSNES_SHOR,)
    saved = scene.save(tmp_path / "resolved.toml")
    assert "sections" not in saved.read_text()
    assert Scene.load(saved) == scene


SCENE = """
title = "a string"
duration = 1
[verdict]
element = "bit"
[[plant]]
part = "DrillString"
sections = "tables/string.csv"
{}
[[plant]]
part = "BitRock"
"""


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ('top_inertia = "2 t m2"\nband = "2 Hz"\nelements = 7\non_bottom = true', None),
        ("", "The key `top_inertia` is missing in DrillString"),
        ("top_inertia = 2000\nbandd = 3", "no key `bandd` in DrillString: did you mean `band`"),
        ('top_inertia = "2 kg"', "`top_inertia` must be in kg m2"),
        ('top_inertia = 2000\nband = "2 rpm"', "`band` must be in Hz"),
        ("top_inertia = 2000\nelements = 2.5", "`elements` must be an integer"),
        ("top_inertia = 2000\nelements = 0", "`elements` must be an integer >= 1"),
        ('top_inertia = 2000\nsurvey = "tables/hole.csv"', "no table .*hole.csv"),
        ("top_inertia = 2000\nsurvey = 3", "`DrillString.survey` must be text"),
        ('top_inertia = 2000\nfriction = { law = "Coulomb" }', "`survey` must be given with `friction`"),
        ('top_inertia = 2000\nfriction = { law = "Colomb" }', "did you mean `Coulomb`"),
        ("top_inertia = 2000\ninertia = [1.0, 2.0]", "no key `inertia`"),
    ],
)
def test_mistakes_about_tables_in_a_scene_are_one_clear_error(tmp_path, lines, words):
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables" / "string.csv").write_text("length [m],OD [in],ID [in],material\n1000,5,4.276,steel\n")
    path = tmp_path / "scene.toml"
    path.write_text(SCENE.format(lines))
    if words is None:
        (string, _) = Scene.load(path).parts
        assert string == DrillString.from_tables(tmp_path / "tables" / "string.csv", top_inertia=2000.0, elements=7, on_bottom=True)
    else:
        with pytest.raises(SceneError, match=words) as refused:
            Scene.load(path)
        assert "scene.toml" in str(refused.value)


def test_a_bad_table_in_a_scene_names_the_scene_the_table_and_the_cell(tmp_path):
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables" / "string.csv").write_text("length [m],OD [in],ID [in],material\n1000,5,6,steel\n")
    path = tmp_path / "scene.toml"
    path.write_text(SCENE.format("top_inertia = 2000"))
    with pytest.raises(SceneError, match=r"Scene .*scene.toml.*Table .*string.csv.*row 1 \(line 2\), column `ID \[in\]`"):
        Scene.load(path)
