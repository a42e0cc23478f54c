"""Modes of strings against closed forms."""

import numpy as np
import pytest

from models import DrillString, Section, TorsionalChain, wells
from tests.plants import RIG
from toolbox import SceneError, compose
from toolbox.steady_states import ModeShapes, mode_shapes

N, K, J = 6, 4.0, 0.25


def test_a_free_row_of_equal_inertias_has_the_modes_of_the_textbook():
    """Frequencies 2 sqrt(k / J) sin(i pi / 2 n), shapes cos(i pi (j + 1/2) / n) (textbook)."""
    found = mode_shapes(compose(TorsionalChain(inertia=(J,) * N, stiffness=(K,) * (N - 1), damping=(0.0,) * (N - 1))))
    i = np.arange(1, N)
    assert found.frequencies == pytest.approx(2 * np.sqrt(K / J) * np.sin(i * np.pi / (2 * N)) / (2 * np.pi))
    assert np.abs(found.damping).max() < 1e-9
    exact = np.cos(np.outer(i, np.arange(N) + 0.5) * np.pi / N)
    exact /= np.abs(exact).max(axis=1)[:, None]
    for shape, form in zip(found.shapes, exact, strict=True):
        assert np.abs(shape) == pytest.approx(np.abs(form), abs=1e-9)
        assert np.sign(shape * shape[0])[np.abs(form) > 1e-9] == pytest.approx(np.sign(form * form[0])[np.abs(form) > 1e-9])


def test_a_held_bit_does_not_move_and_leaves_the_top_to_swing_on_the_string():
    held = mode_shapes(RIG, mode={"bit": "stick"})
    inertia, stiffness = wells.JANSEN_2.inertia[0], wells.JANSEN_2.stiffness[0]
    assert abs(held.shapes[0][-1]) < 1e-9 and held.shapes[0][0] == pytest.approx(1.0, rel=1e-14)
    assert np.abs(held.poles[0]) == pytest.approx(np.sqrt(stiffness / inertia))


def test_the_picture_tells_the_frequencies(tmp_path):
    found = mode_shapes(compose(TorsionalChain(inertia=(J,) * N, stiffness=(K,) * (N - 1), damping=(0.01,) * (N - 1))))
    ax = found.plot(most=3)
    words = [text.get_text() for text in ax.get_legend().get_texts()]
    assert len(words) == 3 and words[0].startswith(f"{found.frequencies[0]:.3g} Hz")
    assert "mode" in str(found) and found.to_csv(tmp_path / "modes.csv").read_text().count("\n") == N


def test_a_string_that_knows_the_depths_of_its_inertias_is_drawn_over_depth(tmp_path):
    string = DrillString.from_tables([Section(1000.0, 0.127, 0.1086), Section("200 m", 0.17, 0.07)], top_inertia=2000.0, elements=12)
    found = mode_shapes(compose(string))
    assert found.depth.tolist() == list(string.depth) and found.depth[-1] == 1200.0
    ax = ModeShapes.load(found.save(tmp_path / "modes.npz")).plot()
    assert ax.get_ylabel() == "measured depth [m]" and ax.lines[0].get_ydata().tolist() == list(string.depth)
    low, high = ax.get_ylim()
    assert low > 1200.0 and high < 0.0  # the top is at the top
    assert mode_shapes(compose(wells.JANSEN_2), "chain.speed").plot().get_ylabel() == "entry of chain speed, from the top"


def test_what_has_no_shapes_is_refused():
    rig = compose(TorsionalChain(inertia=(J,) * 3, stiffness=(K,) * 2, damping=(0.0,) * 2))
    with pytest.raises(SceneError, match="vector of speeds, chain.speed, but it is 'chain.twist'"):
        mode_shapes(rig, "chain.twist")
