"""The chance of stick-slip, with bounds."""

import re

import numpy as np
import pytest
from scipy import stats

import toolbox.measuring.verdict as rules
import toolbox.probability.chances as verb
from controllers import SoftTorque, StiffPI
from models import BitRock, Coulomb, TorsionalChain, wells
from toolbox import SceneError, closed_loop, compose, simulate
from toolbox.onsets.coming_to import comes_to
from toolbox.onsets.map_loop import NONE, SMOOTH, STICK_SLIP, STUCK, VERDICTS
from toolbox.probability import Chance, chance
from toolbox.probability.bounds import clopper_pearson
from toolbox.sweeps.designs import Variations

OVER = {"top.reference": [6.0, 11.0]}
UNCERTAIN = {"bit.weight": "70 kN +- 10 kN", "bit.friction.static": "0.8 +- 0.05"}


@pytest.fixture(scope="module")
def loop():
    return closed_loop(compose(wells.JANSEN_2, BitRock()), StiffPI())


def result(outcomes, label="law", axis=(1.0, 2.0, 3.0)):
    outcomes = {label: np.array(outcomes, np.int8)} if not isinstance(outcomes, dict) else outcomes
    return Chance(
        "a case", tuple(outcomes), ("top.reference",), ("rad/s",), (np.array(axis),), {}, outcomes,
        {name: np.zeros(each.shape) for name, each in outcomes.items()}, 100.0, 1e-4, 0.95, dict.fromkeys(outcomes, 0),
    )  # fmt: skip


def test_bounds_are_those_of_clopper_and_pearson():
    for k in (0, 3, 40, 72):
        low, high = clopper_pearson(k, k, 72, 0.95)
        truth = stats.binomtest(k, 72).proportion_ci(0.95, method="exact")
        assert (float(low), float(high)) == pytest.approx((truth.low, truth.high), abs=1e-12)


def test_72_draws_are_the_least_that_show_95_per_cent():
    assert clopper_pearson(0, 0, 72, 0.95)[1] <= 0.05 < clopper_pearson(0, 0, 71, 0.95)[1]
    assert result(np.zeros((3, 72))).lowest()["law"] == 1.0
    with pytest.raises(SceneError, match="takes at least 72 draws"):
        result(np.zeros((3, 71))).lowest()


def test_the_lowest_set_point_is_free_from_there_on():
    outcomes = np.zeros((3, 100))
    outcomes[1] = STICK_SLIP
    assert result(outcomes).lowest()["law"] == 3.0
    outcomes[2] = STICK_SLIP
    assert np.isnan(result(outcomes).lowest()["law"])


def test_a_run_of_which_nobody_knows_widens_the_bounds_to_both_sides():
    outcomes = np.full((1, 100), SMOOTH)
    outcomes[0, :20], outcomes[0, 20:30] = STICK_SLIP, NONE
    found = result(outcomes, axis=(1.0,))
    low, high = found.bounds["law"]
    assert low == clopper_pearson(20, 20, 100, 0.95)[0] and high == clopper_pearson(30, 30, 100, 0.95)[1]
    assert found.chances["law"] == pytest.approx(20 / 90)


def test_laws_are_compared_draw_by_draw():
    one, other = np.zeros((1, 50), np.int8), np.zeros((1, 50), np.int8)
    other[0, :12], one[0, 40:42] = STICK_SLIP, STICK_SLIP
    first, second, p = result({"one": one, "other": other}, axis=(1.0,)).better("one", "other")
    assert (first[0], second[0]) == (12 / 50, 2 / 50) and p[0] == pytest.approx(stats.binomtest(2, 14, 0.5).pvalue)


def test_lanes_decide_as_the_judge_does(loop):
    found = chance(loop, OVER, UNCERTAIN, draws=30)
    search = verb.Search(loop, verb.grid(OVER), verb.drawn(loop, UNCERTAIN, 30), found.duration, None, 1e-4)
    rows, outcomes = search._rows(0, 2), found.outcomes["as it is"].ravel()
    assert {SMOOTH, STICK_SLIP} == set(outcomes.tolist())
    for row, outcome in list(zip(rows.tolist(), outcomes.tolist(), strict=True))[::4]:
        case = loop
        for name, value in zip(search.names, row, strict=True):
            case = case.at(name, value)
        run = simulate(case, found.duration, accuracy=1e-6)
        assert VERDICTS[comes_to(run, "bit", "bit.speed", found.duration / 2).regime] == outcome


def test_a_swing_that_has_died_out_needs_no_judge_and_is_as_he_says(monkeypatch):
    loop = closed_loop(compose(wells.JANSEN_2, BitRock()), SoftTorque())
    found = chance(loop, OVER, UNCERTAIN, draws=16)
    monkeypatch.setattr(rules, "DIED_OUT", 0.0)
    by_judge = chance(loop, OVER, UNCERTAIN, draws=16)
    assert np.array_equal(found.outcomes["as it is"], by_judge.outcomes["as it is"])
    assert found.judged_runs["as it is"] < 0.25 * by_judge.judged_runs["as it is"]


@pytest.mark.parametrize("duration", [None, 150.0])
def test_a_machine_that_slows_down_until_it_stands_is_not_free(duration):
    """Under constant friction a constant torque turns the bit for ever or never: it stands where the friction is larger, however long it takes."""
    torque, share = 8000.0, 0.5
    bit = BitRock(friction=Coulomb(static=share, kinetic=share))
    loop = closed_loop(compose(TorsionalChain(bit_drag=10.0), bit), inputs={"top.torque": torque})
    found = chance(loop, {"top.torque": [torque]}, {"bit.weight": "98 kN +- 5 kN"}, draws=100, duration=duration)
    weights = verb.drawn(loop, {"bit.weight": "98 kN +- 5 kN"}, 100).points[:, 0]
    stands = weights * share * bit.radius > torque
    assert 8 < stands.sum() < 30
    assert np.array_equal(found.outcomes["as it is"][0], np.where(stands, STUCK, SMOOTH))


@pytest.mark.slow
def test_bounds_cover_a_probability_that_is_known(loop):
    case = loop.at("top.reference", 9.0)

    def sticks(weight):
        run = simulate(case.at("bit.weight", weight), 150.0, accuracy=1e-6)
        return comes_to(run, "bit", "bit.speed", 75.0).regime == "sticks and slips"

    low, high = 30e3, 110e3
    assert not sticks(low) and sticks(high)
    while high - low > 20.0:
        middle = (low + high) / 2
        low, high = (low, middle) if sticks(middle) else (middle, high)
    border = (low + high) / 2
    truth = stats.norm(border - 6e3, 8e3).sf(border)  # 0.227
    found = chance(case, {"top.reference": [9.0]}, {"bit.weight": f"{border - 6e3} +- 8000"}, draws=200 * 80)
    repeats = (found.outcomes["as it is"].reshape(200, 80) == STICK_SLIP).sum(axis=1)
    lower, upper = clopper_pearson(repeats, repeats, 80, 0.95)
    covered = ((lower <= truth) & (truth <= upper)).sum()
    print(f"{covered} of 200 bounds cover {truth:.4f}")
    assert covered >= 182


def test_a_result_goes_to_a_file_and_comes_back(loop, tmp_path):
    found = chance(loop, OVER, UNCERTAIN, draws=8)
    again = Chance.load(found.save(tmp_path / "chance.npz"))
    assert str(again) == str(found) and np.array_equal(again.outcomes["as it is"], found.outcomes["as it is"])
    table = found.save(tmp_path / "chance.csv").read_text()
    assert table.splitlines()[0] == "controller,top.reference,chance,lower,upper,severity" and len(table.splitlines()) == 3


def test_the_same_call_goes_on_where_it_was(loop, tmp_path, monkeypatch):
    asked = {"draws": 8, "checkpoint": tmp_path}
    monkeypatch.setattr(verb, "BLOCK", 8)
    first = chance(loop, OVER, UNCERTAIN, **asked)
    journal = tmp_path / "chance_01.jsonl"
    lines = journal.read_text().splitlines(keepends=True)
    journal.write_text("".join(lines[:-1]))
    rows = []
    real = verb.Search.block
    monkeypatch.setattr(verb.Search, "block", lambda self, given: (rows.append(len(given)), real(self, given))[1])
    again = chance(loop, OVER, UNCERTAIN, **asked)
    assert rows == [8] and np.array_equal(again.outcomes["as it is"], first.outcomes["as it is"])
    with pytest.raises(SceneError, match="another `uncertainty`"):
        chance(loop, OVER, UNCERTAIN, seed=1, **asked)


@pytest.mark.parametrize(
    "over, more, words",
    [
        ({"bit.weight": [5e4]}, {}, "must not name what is varied, but `bit.weight`"),
        ({}, {}, "must map one or two names to values"),
        (OVER, {"duration": 20.0}, "so that sticks can be counted"),
        (OVER, {"draws": 0}, "`draws` must be an integer >= 1"),
        (OVER, {"confidence": 1.5}, "`confidence` must be"),
    ],
)
def test_what_makes_no_sense_is_refused(loop, over, more, words):
    with pytest.raises(SceneError, match=words):
        chance(loop, over, UNCERTAIN, **{"draws": 4, **more})


def test_the_duration_that_is_said_to_be_enough_is_the_shortest_that_is_taken(loop):
    points, known = Variations(("top.reference",), np.array([[8.0], [9.0]]), (2,)), Variations(("bit.weight",), np.array([[7e4]]), (1,))
    with pytest.raises(SceneError, match="so that sticks can be counted") as refusal:
        verb.Search(loop, points, known, 20.0, None, 1e-4)
    shortest = float(re.search(r"at least (\S+) s", str(refusal.value))[1])
    assert verb.Search(loop, points, known, 1.001 * shortest, None, 1e-4).duration == 1.001 * shortest
    with pytest.raises(SceneError, match="so that sticks can be counted"):
        verb.Search(loop, points, known, 0.999 * shortest, None, 1e-4)


def test_pictures_show_curves_over_one_number_and_panels_over_two(loop):
    found = chance(loop, OVER, UNCERTAIN, draws=8)
    assert found.plot().get_ylabel() == "chance of stick-slip [1]"
    both = chance({"stiff PI": loop}, {**OVER, "chain.bit_drag": [40.0, 60.0]}, UNCERTAIN, draws=4)
    assert both.plot()[0, 0].get_title() == "stiff PI"
