"""The policy that learns: it is the same law in its environment and in the toolbox, and training ends the stick-slip that it begins with."""

import numpy as np
import pytest

pytest.importorskip("gymnasium", reason="an environment needs gymnasium, which is not here")
from studies.questions.learned_policy import FIRST, PERIOD, REFERENCE, RIG, LearnedPolicy, acts, train, training, verdicts
from toolbox import Sampled, closed_loop, simulate

GAINS = (0.1, 0.12, 0.05)


def test_the_policy_moves_the_rig_in_its_environment_as_it_does_as_a_law():
    made, angle, slow = training(), 0.0, 0.0
    start = {"chain.speed.0": 6.0, "chain.twist.0": 18.0}
    seen, _ = made.reset(options={"start": start})
    found = [seen]
    for _ in range(400):
        torque, angle, slow = acts(GAINS, REFERENCE - seen[0], angle, slow)
        seen, *_ = made.step(np.array([float(torque)]))
        found.append(seen)
    run = simulate(closed_loop(RIG, Sampled(LearnedPolicy(GAINS), PERIOD), start={"chain.speed": (6.0, 0.0), "chain.twist": (18.0,)}), 20.0)
    for i, name in enumerate(("top.speed", "bit.speed")):
        np.testing.assert_allclose(np.array(found)[:, i], run.at(PERIOD * np.arange(401))[name], atol=1e-4)


@pytest.mark.slow
def test_training_ends_the_stick_slip_that_the_policy_begins_with():
    pytest.importorskip("cma", reason="training needs cma, which is not here")
    gains, trained, first = train(100, 1)
    assert trained < 0.5 * first and gains != FIRST
    for text in verdicts(gains).values():
        lines = {line.split("  ")[0]: line for line in text.splitlines()}
        assert (
            " free " in lines["policy, trained"] and "stick-slip" in lines["policy before training"] and "stick-slip" in lines["stiff PI"]
        )
