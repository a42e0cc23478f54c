"""A reduced body as a value and as a file, and a scene whose plant has one."""

import math
import shutil
from dataclasses import fields, replace

import numpy as np
import pytest

from models import ElasticBody, ElasticSlider, PlateContact, ReducedBody, Slider
from toolbox import Scene, SceneError, compose, simulate
from toolbox.inputs import ramp


def chain(contacts=3):
    """Masses in a row, joined by springs, a contact under each, with one mode."""
    n = contacts + 1
    matrix = 1e6 * (np.diag([1.0, *[2.0] * (n - 2), 1.0]) - np.eye(n, k=1) - np.eye(n, k=-1))
    body = ElasticBody(0.01 * np.eye(n), matrix, 1e-4 * matrix)
    return body.reduced({f"contact.{i}": np.eye(n)[i] for i in range(contacts)}, 2000.0)


SCENE = """
title = "Row of masses"
duration = "0.1 s"
verdict = {{ element = "plate.1" }}
inputs = {{ "plate.speed" = "10 mm/s" }}

[[plant]]
part = "ElasticSlider"
held = "contact.0"
loads = ["2 N", "3 N", 2.5]
body = {body}
"""


@pytest.fixture
def scene(tmp_path):
    chain().save(tmp_path / "chain.npz")

    def written(body='"chain.npz"'):
        (tmp_path / "row.toml").write_text(SCENE.format(body=body))
        return tmp_path / "row.toml"

    return written


def test_a_body_that_is_saved_and_loaded_is_equal_in_all_it_holds(tmp_path):
    body = chain()
    again = ReducedBody.load(body.save(tmp_path / "chain.npz"))
    assert again == body
    assert body.modes == 1
    for spec in fields(body):
        np.testing.assert_array_equal(getattr(again, spec.name), getattr(body, spec.name))


def test_a_scene_names_the_file_of_a_body_from_its_own_folder_and_is_saved_whole(scene, tmp_path):
    loaded = Scene.load(scene())
    assert loaded.parts[0] == ElasticSlider(chain(), (2.0, 3.0, 2.5), support_port="contact.0")
    (tmp_path / "far").mkdir()
    saved = loaded.save(tmp_path / "far" / "again.toml")
    (tmp_path / "chain.npz").unlink()
    assert Scene.load(saved) == loaded


def test_a_scene_may_hold_the_matrices_of_a_body(scene):
    loaded = Scene.load(
        scene(
            "{ ports = ['contact.0', 'contact.1', 'contact.2'], mass = [[1, 0, 0], [0, 1, 0], [0, 0, 2]], "
            "damping = [[0, 0, 0], [0, 0, 0], [0, 0, 0]], stiffness = [[1e4, -1e4, 0], [-1e4, 2e4, -1e4], [0, -1e4, 1e4]] }"
        )
    )
    assert loaded.parts[0].body.stiffness[1, 1] == 2e4
    assert loaded.parts[0].body.modes == 0


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ('"chian.npz"', r"no file .*chain\.npz"),
        ('"row.toml"', "must end in .npz"),
        ('"broken.npz"', "broken.npz"),
        ("3", "must be the path of a file, or a table"),
        ('{ ports = ["contact.0"] }', "`mass` is missing"),
        ("{ prots = [] }", "did you mean `ports`"),
        ('{ ports = ["a"], mass = [[1, 2]], damping = [[0]], stiffness = [[1]] }', "`mass` must be a square"),
        ('{ ports = ["a", "a"], mass = [[1]], damping = [[0]], stiffness = [[1]] }', "each once"),
    ],
)
def test_a_scene_whose_body_is_none_says_so(scene, tmp_path, body, words):
    content = (tmp_path / "chain.npz").read_bytes()
    (tmp_path / "broken.npz").write_bytes(content[: len(content) // 2])
    with pytest.raises(SceneError, match=words) as raised:
        Scene.load(scene(body))
    assert "ElasticSlider.body" in str(raised.value)


def test_every_damaged_byte_of_a_file_is_seen_or_harmless(tmp_path):
    """One byte in seven is turned: the body is refused with an error that names the file, or it is the same."""
    body = chain()
    whole = body.save(tmp_path / "chain.npz").read_bytes()
    refused = 0
    for i in range(0, len(whole), 7):
        (tmp_path / "chain.npz").write_bytes(whole[:i] + bytes([whole[i] ^ 0x55]) + whole[i + 1 :])
        try:
            assert ReducedBody.load(tmp_path / "chain.npz") == body
        except SceneError as error:
            refused += 1
            assert "chain.npz" in str(error)
    assert refused > len(whole) / 14


def test_a_file_keeps_places_and_areas_of_contacts_and_one_triangle_of_symmetric_matrices(tmp_path):
    body = replace(chain(), contact_positions=[[0.0, 1.0]], contact_areas=[2e-6])
    assert body != chain() and replace(chain(), contact_areas=[2e-6]) != chain()
    again = ReducedBody.load(body.save(tmp_path / "chain.npz"))
    assert again == body and np.array_equal(again.contact_positions, [[0.0, 1.0]]) and np.array_equal(again.contact_areas, [2e-6])
    with np.load(tmp_path / "chain.npz") as data:
        assert np.array_equal(data["stiffness"], np.triu(body.stiffness)) and np.count_nonzero(np.tril(body.stiffness, -1))
    rounded = body.stiffness.copy()
    rounded[0, -1] += 1e-12 * np.abs(rounded).max()  # symmetric but for round-off: kept as it is
    uneven = replace(body, stiffness=rounded)
    assert ReducedBody.load(uneven.save(tmp_path / "uneven.npz")) == uneven
    assert ReducedBody.load(chain().save(tmp_path / "plain.npz")).contact_positions is None


@pytest.mark.parametrize("lacks", ["mass", "ports", "rigid_body_modes"])
def test_a_file_that_lacks_an_array_or_has_another_one_is_refused(tmp_path, lacks):
    arrays = {
        spec.name: np.asarray(getattr(chain(), spec.name))
        for spec in fields(ReducedBody)
        if spec.name not in ("contact_positions", "contact_areas")
    }
    np.savez(tmp_path / "body.npz", **{name: value for name, value in arrays.items() if name != lacks})
    with pytest.raises(SceneError, match=f"lacks `{lacks}`"):
        ReducedBody.load(tmp_path / "body.npz")
    np.savez(tmp_path / "body.npz", **arrays, extra=1)
    with pytest.raises(SceneError, match="holds `extra`"):
        ReducedBody.load(tmp_path / "body.npz")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"ports": ()}, "at least one"),
        ({"ports": "ab"}, "names of ports"),
        ({"ports": ("a", "b", "c")}, "at least 3 rows"),
        ({"mass": [[1.0, 0.0], [0.0, 0.0]]}, "positive definite"),
        ({"mass": [[1.0, 2.0], [2.0, 1.0]]}, "positive definite"),
        ({"stiffness": [[1.0, 2.0], [0.0, 1.0]]}, "symmetric"),
        ({"stiffness": [[1.0]]}, "2 rows"),
        ({"damping": [[math.nan, 0.0], [0.0, 1.0]]}, "finite"),
        ({"damping": "none"}, "`damping` must be finite numbers"),
        ({"contact_positions": [1.0, 2.0]}, "`contact_positions` must be finite numbers of the shape"),
        ({"contact_positions": [[math.nan]]}, "`contact_positions` must be finite"),
        ({"contact_areas": [[1.0]]}, "`contact_areas` must be finite numbers of the shape"),
        ({"cutoff_frequency": -1.0}, "cutoff_frequency"),
        ({"rigid_body_modes": 0.5}, "`rigid_body_modes` must be an integer"),
        ({"frequencies": [100.0]}, "1 entries"),
        ({"frequencies": [[100.0]], "frequency_errors": [[0.1]]}, r"of the shape \(any,\)"),
    ],
)
def test_matrices_that_are_no_body_are_refused(changes, words):
    unit = np.eye(2)
    with pytest.raises(SceneError, match=words):
        ReducedBody(**{"ports": ("a", "b"), "mass": unit, "damping": 0 * unit, "stiffness": unit} | changes)


def first_slips(run):
    return {event.element: event.time for event in reversed(run.events) if event.before == "stick"}


def test_the_rows_of_the_shipped_scene_let_go_one_by_one_and_the_last_with_the_rigid_slider(root):
    run = Scene.load(root / "studies" / "scenes" / "elastic_slider.toml").run("held")
    rigid = simulate(compose(Slider(), PlateContact()), 0.3, inputs={"plate.speed": ramp(0.0, 0.01, 0.0, 4.0)}, accuracy=1e-9)
    found = first_slips(run)
    assert set(found) == {f"plate.{i}" for i in range(11)}
    assert max(found.values()) == pytest.approx(rigid.events[0].time, rel=1e-3)
    assert min(found.values()) < 0.5 * max(found.values())


@pytest.mark.slow
def test_the_shipped_body_is_that_of_the_mesh_and_shaking_lets_its_rows_go_earlier(root):
    study = pytest.importorskip("studies.questions.elastic_sliders")
    scene = Scene.load(root / "studies" / "scenes" / "elastic_slider.toml")
    mesh, part = study.row_slider(), scene.parts[0]
    np.testing.assert_allclose(part.loads, mesh.loads, rtol=1e-9)
    assert part.body.ports == mesh.body.ports
    for word in ("mass", "damping", "stiffness"):
        wanted = getattr(mesh.body, word)
        np.testing.assert_allclose(getattr(part.body, word), wanted, atol=1e-9 * np.abs(wanted).max())
    assert max(first_slips(scene.run("shaken at 200 Hz")).values()) < 0.9 * max(first_slips(scene.run("held")).values())


@pytest.mark.slow
def test_a_folder_of_a_study_stands_by_itself(scene, tmp_path, root):
    """What a study writes holds the body, so the folder may be moved."""
    from toolbox.commands.command_line import main

    assert main(["study", str(scene()), "--out", str(tmp_path / "out")]) == 0
    shutil.move(tmp_path / "out", tmp_path / "moved")
    (tmp_path / "chain.npz").unlink()
    assert Scene.load(tmp_path / "moved" / "scene.toml").parts[0].body == chain()
