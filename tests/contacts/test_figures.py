"""Pictures of a face: what is drawn is what the run holds."""

import dataclasses

import numpy as np
import pytest
from PIL import Image

from models import Coulomb
from toolbox import SceneError
from toolbox.contacts import ContactProblem, step_contacts
from toolbox.inputs import ramp


@pytest.fixture(scope="module")
def run():
    """Nine masses on springs, some above a gap; a plate draws the others along."""
    c = 9
    unit = np.eye(3 * c)
    closing = unit[2 * c :]
    tangent = np.stack([unit[:c], unit[c : 2 * c]], axis=1)
    places = np.array([(x, y, 0.0) for x in (0.0, 1e-3, 2e-3) for y in (0.0, 1e-3, 2e-3)])
    problem = ContactProblem(
        np.eye(3 * c), 1e4 * np.eye(3 * c), tangent, Coulomb(0.3, 0.3), normal=closing, gap=np.where(np.arange(c) < 3, 1.0, 0.0),
        damping=100.0 * np.eye(3 * c), force_inputs={"press": closing.T @ np.linspace(1.0, 3.0, c)}, surface_velocity={"plate": np.tile([1.0, 0.0], (c, 1))},
        contact_positions=places, contact_areas=np.full(c, 1e-6),
    )  # fmt: skip
    return step_contacts(problem, 0.1, step=2e-3, inputs={"press": 10.0, "plate": ramp(0.0, 0.02, 0.0, 0.1)})


def test_the_shares_over_time_are_drawn_and_add_up_to_one(run):
    ax = run.plot_share()
    drawn = {line.get_label(): line.get_ydata() for line in ax.get_lines()}
    assert set(drawn) == {"stick", "slip", "open"}
    np.testing.assert_allclose(sum(drawn.values()), 1.0)
    np.testing.assert_allclose(drawn["stick"], run.share())
    assert ax.get_xlabel() == "time [s]"


def test_a_map_shows_every_contact_in_its_mode(run):
    ax = run.plot_map()  # at the end
    drawn = {collection.get_label(): len(collection.get_offsets()) for collection in ax.collections}
    assert drawn == {
        word: int((run.contact_modes[-1] == code).sum())
        for code, word in enumerate(("stick", "slip", "open"))
        if (run.contact_modes[-1] == code).any()
    }
    assert drawn["open"] == 3


@pytest.mark.parametrize(
    ("values", "factor", "unit"), [("pressure", 1e-6, "[MPa]"), ("traction", 1e-6, "[MPa]"), ("friction_work", 1e3, "[mJ]")]
)
def test_fields_are_drawn_in_the_unit_that_their_bar_says(run, values, factor, unit):
    ax = run.plot_map(run.end, values)
    assert unit in ax.figure.axes[-1].get_xlabel()
    np.testing.assert_allclose(ax.collections[0].get_array(), factor * getattr(run, values)[-1])


def test_the_figure_of_a_run_shows_shares_the_face_at_four_instants_and_its_fields(run):
    axes = run.plot()
    figure = axes[0].figure
    assert axes.size == 10 and all(ax.figure is figure for ax in axes)
    assert {line.get_label() for line in axes[0].get_lines() if len(line.get_xdata()) > 2} == {"stick", "slip", "open"}
    instants = [line.get_xdata()[0] for line in axes[0].get_lines() if len(line.get_xdata()) == 2]
    shown = [float(ax.get_title().partition(" s")[0]) for ax in axes[2:6]]
    np.testing.assert_allclose(instants, shown, rtol=1e-3)
    changes = np.diff(run.contact_modes, axis=0).astype(bool).sum(axis=1).cumsum()
    for part, instant in zip((0.2, 0.4, 0.6, 0.8), instants, strict=True):
        assert changes[np.flatnonzero(run.time[1:] < instant - 1e-9)].max(initial=0) < part * changes[-1]
    np.testing.assert_allclose(axes[8].collections[0].get_array(), 1e3 * run.friction_work[-1])
    assert {text.get_text() for text in axes[9].get_legend().get_texts()} >= {"slip", "open"}
    assert all(ax.title.get_fontsize() <= ax.xaxis.label.get_fontsize() for ax in axes if ax.get_title())


def test_the_figure_of_a_run_without_places_shows_shares_and_forces(run):
    bare = dataclasses.replace(run, problem=dataclasses.replace(run.problem, contact_positions=None))
    shares, forces = bare.plot()
    assert shares.get_ylabel() == "share of the area [1]" and forces.get_ylabel() == "sum of forces [N]"
    drawn = {line.get_label(): line.get_ydata() for line in forces.get_lines()}
    assert set(drawn) == {"normal", "tangential 0"}  # nothing moves along the other direction
    np.testing.assert_allclose(drawn["normal"], run.normal.sum(axis=1))
    np.testing.assert_allclose(drawn["tangential 0"], run.tangential[:, :, 0].sum(axis=1))


def test_a_face_whose_contacts_never_change_is_shown_at_even_instants(run):
    still = dataclasses.replace(run, contact_modes=0 * run.contact_modes)
    assert [ax.get_title() for ax in still.plot()[2:6]] == [f"{instant:.4g} s: 100% stick" for instant in (0.024, 0.05, 0.076, 0.1)]


def test_a_film_has_its_frames_and_is_written_whole(run, tmp_path):
    run.animate(tmp_path / "face.gif", frames=5, seconds=1.0)
    with Image.open(tmp_path / "face.gif") as film:
        assert film.n_frames > 1
    assert [path.name for path in tmp_path.iterdir()] == ["face.gif"]


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda run: run.plot_map(1.0), ">= 0 and <= 0.1 s"),
        (lambda run: run.plot_map(0.05, "speed"), "pressure, traction"),
        (lambda run: run.animate("face.mp4"), ".gif"),
        (lambda run: run.animate("face.gif", frames=1), "frames"),
        (lambda run: run.share("stuck"), "stick, slip or open"),
        (lambda run: run["back"], "no output"),
    ],
)
def test_what_cannot_be_shown_is_refused(run, ask, words):
    with pytest.raises(SceneError, match=words):
        ask(run)


def test_a_face_without_places_has_no_map(run):
    from dataclasses import replace

    bare = replace(run, problem=replace(run.problem, contact_positions=None))
    for ask in (lambda: bare.plot_map(0.05), lambda: bare.animate("face.gif")):
        with pytest.raises(SceneError, match="contact_positions"):
            ask()
