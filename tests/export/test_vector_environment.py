"""Copies of a machine that are stepped together move as each does alone."""

import numpy as np
import pytest

from controllers import StiffPI
from tests.plants import RIG
from toolbox import Sampled, SceneError, closed_loop

pytest.importorskip("gymnasium", reason="an environment needs gymnasium, which is not here")
import gymnasium

from toolbox.export.environment import environment
from toolbox.export.vector_environment import vector_environment

COUNT = 3
GIVEN = {
    "actions": {"top.torque": (0.0, 20e3)}, "observations": {"top.speed": (-50.0, 50.0), "bit.speed": (-50.0, 50.0)},
    "start": lambda draw: {"chain.speed.0": draw.uniform(0.0, 5.0), "chain.speed.1": 2.0},
}  # fmt: skip


@pytest.mark.parametrize("torque", [False, True])
def test_copies_move_as_single_environments_do_and_begin_anew_when_their_time_is_over(torque):
    given = GIVEN | {"observations": GIVEN["observations"] | ({"bit.torque": (-1e5, 1e5)} if torque else {})}
    together = vector_environment(RIG, COUNT, 0.05, 2.0, reward=lambda signals, switches: -np.abs(signals["bit.speed"]) - switches, **given)
    alone = [environment(RIG, 0.05, 2.0, reward=lambda s, events: -abs(s["bit.speed"]) - len(events), **given) for _ in range(COUNT)]
    seen, _ = together.reset(seed=5)
    np.testing.assert_array_equal(seen, [each.reset(seed=5 + i)[0] for i, each in enumerate(alone)])
    draw, fastest, torques = np.random.default_rng(1), 0.0, np.zeros((COUNT, 1))
    for k in range(45):
        if k % 3 != 1:
            torques = draw.uniform(-1e3, 25e3, (COUNT, 1))  # beyond the range, too
        seen, gains, ended, late, _ = together.step(torques)
        if k == 40:  # the step in which they begin anew
            np.testing.assert_array_equal(seen, [each.reset()[0] for each in alone])
            assert not gains.any() and not late.any()
            continue
        singles = [each.step(given) for each, given in zip(alone, torques, strict=True)]
        np.testing.assert_array_equal(seen, [each[0] for each in singles])
        np.testing.assert_array_equal(gains, [each[1] for each in singles])
        fastest = max(fastest, seen[:, 1].max())
        assert late.all() == singles[0][3] == (k == 39) and not ended.any()
    assert together.observation_space.contains(seen) and fastest > 0.1
    together.close()


def test_it_answers_as_gymnasiums_own_vector_of_single_environments_does():
    """Its seeds, its shapes, and how a copy whose time is over begins anew."""
    together = vector_environment(RIG, COUNT, 0.05, 0.5, reward=lambda signals, switches: -np.abs(signals["bit.speed"]) - switches, **GIVEN)
    made = [lambda: environment(RIG, 0.05, 0.5, reward=lambda s, events: -abs(s["bit.speed"]) - len(events), **GIVEN)] * COUNT
    theirs = gymnasium.vector.SyncVectorEnv(made)
    assert together.metadata["autoreset_mode"] == theirs.metadata["autoreset_mode"]
    for word in ("single_observation_space", "single_action_space", "observation_space", "action_space", "num_envs"):
        assert getattr(together, word) == getattr(theirs, word)
    np.testing.assert_array_equal(together.reset(seed=3)[0], theirs.reset(seed=3)[0])
    overs = 0
    for k in range(25):
        actions = np.random.default_rng(k).uniform(0.0, 20e3, (COUNT, 1))
        answers = together.step(actions)[:4]
        for mine, other in zip(answers, theirs.step(actions)[:4], strict=True):
            np.testing.assert_array_equal(mine, other)
            assert mine.dtype == other.dtype and mine.shape == other.shape
        overs += int(answers[3].all())
    assert overs == 2


def test_noise_of_laws_is_that_of_single_environments():
    loop = closed_loop(RIG, Sampled(StiffPI(reference=12.0), 0.01, noise={"top.speed": 0.05}))
    given = {"actions": {"bit.weight": (50e3, 100e3)}, "observations": {"top.speed": (-50.0, 50.0)}}
    together = vector_environment(loop, 2, 0.1, 5.0, reward=lambda signals, switches: signals["top.speed"], **given)
    alone = environment(loop, 0.1, 5.0, reward=lambda signals, events: signals["top.speed"], **given)
    together.reset(seed=[3, 4])
    alone.reset(seed=4)
    for _ in range(30):
        seen, *_ = together.step(np.full((2, 1), 80e3))
        single, *_ = alone.step(np.array([80e3]))
        assert seen[1] == single
    assert seen[0] != seen[1]


def test_a_wrong_count_is_told():
    with pytest.raises(SceneError, match="count"):
        vector_environment(RIG, 0, 0.1, 1.0, reward=lambda signals, switches: switches, **GIVEN)
