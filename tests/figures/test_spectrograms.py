"""Spectrograms show the frequencies that a motion has."""

import numpy as np
import pytest

from controllers import StiffPI
from models import BitRock, TorsionalChain, wells
from toolbox import SceneError, closed_loop, compose, simulate
from toolbox.figures import spectrogram
from toolbox.measuring.measure import stick_intervals


def loudest(ax):
    """Frequency of the loudest row [Hz]."""
    mesh = ax.collections[0]
    rows = np.asarray(mesh.get_array())
    rows = rows.reshape(mesh._meshWidth if rows.ndim == 1 else rows.shape)
    low, high = ax.get_ylim()
    return low + (high - low) * (rows.mean(axis=1).argmax() + 0.5) / rows.shape[0]


@pytest.fixture(scope="module")
def run():
    return simulate(closed_loop(compose(wells.JANSEN_2, BitRock(weight=97_347.0)), StiffPI(reference="60 rpm")), 120.0)


def test_the_loudest_line_of_stick_slip_is_the_rate_of_its_sticks(run):
    ax = spectrogram(run)
    sticks = stick_intervals(run, "bit", 40.0)
    rate = (len(sticks) - 1) / (sticks[-1][0] - sticks[0][0])
    assert "bit speed" in ax.get_ylabel() and loudest(ax) == pytest.approx(rate, abs=1 / 20.0)


def test_a_string_that_swings_freely_shows_its_own_frequency():
    chain = compose(TorsionalChain(inertia=(2.0, 2.0), stiffness=(4.0,), damping=(0.0,)))
    ax = spectrogram(simulate(chain, "200 s", start={"chain.twist.0": 1.0}), "chain.speed.0", window="50 s")
    assert loudest(ax) == pytest.approx(2.0 / (2 * np.pi), abs=1 / 50)  # sqrt(2 k / J)


def test_what_is_no_number_of_the_run_is_refused(run):
    with pytest.raises(SceneError, match="did you mean `bit.speed`"):
        spectrogram(run, "bit.sped")
    with pytest.raises(SceneError, match="is a vector: name an entry"):
        spectrogram(run, "chain.speed")
    with pytest.raises(SceneError, match="`window`"):
        spectrogram(run, window="61 s")
