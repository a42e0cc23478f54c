"""Elastic bodies from matrices: what a reduction keeps exactly, and how well it keeps the rest."""

import math

import numpy as np
import pytest
from scipy.io import mmwrite, savemat
from scipy.sparse import diags

from models import ElasticBody
from toolbox import SceneError

STEEL = {"density": 7800.0, "modulus": 2.1e11}


def rod(elements=60, length=0.5, area=1e-4, density=7800.0, modulus=2.1e11):
    """A free rod of linear elements along x: mass, stiffness, places of its nodes."""
    h = length / elements
    inside = np.full(elements + 1, 2.0)
    inside[[0, -1]] = 1.0
    side = np.ones(elements)
    stiffness = modulus * area / h * diags([-side, inside, -side], [-1, 0, 1])
    mass = density * area * h / 6 * diags([side, 2 * inside, side], [-1, 0, 1])
    return mass, stiffness, np.linspace(0, length, elements + 1)[:, None]


def end_ports(body):
    return {"left": body.point(0, "x"), "right": body.point(len(body.nodes) - 1, "x")}


def test_a_free_rod_has_the_frequencies_of_the_textbook():
    mass, stiffness, nodes = rod()
    found = ElasticBody(mass, stiffness, nodes=nodes).frequencies(40_000.0)
    wave_speed = math.sqrt(2.1e11 / 7800.0)
    exact = np.arange(len(found)) * wave_speed / (2 * 0.5)
    assert found[0] == 0.0
    assert found[1:] == pytest.approx(exact[1:], rel=(math.pi * len(found) / 60) ** 2 / 24)


@pytest.mark.parametrize("band", [3000.0, 12_000.0, 30_000.0])
@pytest.mark.parametrize("tolerance", [1e-2, 1e-4])
def test_every_frequency_of_the_band_is_as_right_as_the_reduction_says(band, tolerance):
    mass, stiffness, nodes = rod()
    body = ElasticBody(mass, stiffness, nodes=nodes)
    reduced = body.reduced(end_ports(body), band, tolerance)
    whole = body.frequencies(band)
    own = ElasticBody(reduced.mass, reduced.stiffness).frequencies(1e9)[: len(whole)]
    assert reduced.rigid_body_modes == 1
    assert own[0] == 0.0
    np.testing.assert_allclose(own[1:], whole[1:], rtol=tolerance)
    np.testing.assert_allclose(own[1:] / whole[1:] - 1, reduced.frequency_errors, atol=1e-9)
    if tolerance == 1e-2:
        assert reduced.size < body.size / 2


def test_a_band_that_asks_more_takes_more_modes_and_one_of_zero_none():
    mass, stiffness, nodes = rod()
    body = ElasticBody(mass, stiffness, nodes=nodes)
    modes = [body.reduced(end_ports(body), band).modes for band in (0.0, 6000.0, 12_000.0, 24_000.0)]
    assert modes[0] == 0
    assert modes == sorted(set(modes))


def test_statics_under_forces_on_ports_are_exact_with_and_without_modes():
    mass, stiffness, nodes = rod()
    body = ElasticBody(mass, stiffness, nodes=nodes).clamped([0])
    ports = {"middle": body.point(30, "x"), "right": body.point(60, "x")}
    force = np.array([30.0, -70.0])
    exact = np.linalg.solve(stiffness.toarray()[1:, 1:], np.column_stack(list(ports.values())) @ force)
    expected = [weights @ exact for weights in ports.values()]
    for band in (0.0, 20_000.0):
        reduced = body.reduced(ports, band)
        assert reduced.rigid_body_modes == 0
        found = np.linalg.solve(reduced.stiffness, np.append(force, np.zeros(reduced.modes)))
        np.testing.assert_allclose(found[:2], expected, rtol=1e-9)


def test_a_port_may_be_a_mean_and_the_force_on_it_is_then_even():
    mass, stiffness, nodes = rod()
    areas = np.zeros(61)
    areas[40:] = 1.0
    areas[[40, 60]] = 0.5
    body = ElasticBody(mass, stiffness, nodes=nodes, faces={"end": areas}).clamped([0])
    reduced = body.reduced({"end": body.mean("end", "x")}, 0.0)
    exact = np.linalg.solve(stiffness.toarray()[1:, 1:], body.mean("end", "x"))
    assert 1 / reduced.stiffness[0, 0] == pytest.approx(body.mean("end", "x") @ exact, rel=1e-9)
    assert len(body.node_row_ports("end", "x", "x")) == 21


def test_rigid_motions_that_no_port_holds_are_kept_as_modes_of_frequency_zero():
    mass, stiffness, _ = rod(6)
    # two rods side by side that do not know of each other
    both = ElasticBody(np.kron(np.eye(2), mass.toarray()), np.kron(np.eye(2), stiffness.toarray()), dof_map=np.arange(14).reshape(2, 7).T)
    reduced = both.reduced({"first": both.point(0, "x")}, 3000.0)
    assert reduced.rigid_body_modes == 2
    frequencies = ElasticBody(reduced.mass, reduced.stiffness).frequencies(1e9)
    assert (frequencies == 0).sum() == 2
    moved = np.zeros(reduced.size)
    moved[0] = 1.0
    np.testing.assert_allclose(reduced.stiffness @ moved, 0.0, atol=1e-9 * stiffness.diagonal().max())


def test_a_rigid_motion_has_the_whole_mass():
    mass, stiffness, nodes = rod()
    body = ElasticBody(mass, stiffness, nodes=nodes)
    reduced = body.reduced(end_ports(body), 12_000.0)
    together = np.append([1.0, 1.0], np.zeros(reduced.modes))
    assert together @ reduced.mass @ together == pytest.approx(7800.0 * 1e-4 * 0.5, rel=1e-9)


def test_modes_that_no_port_moves_can_be_left_out_and_nothing_else_changes():
    mass, stiffness, _ = rod(12)
    both = ElasticBody(np.kron(np.eye(2), mass.toarray()), np.kron(np.eye(2), stiffness.toarray()), dof_map=np.arange(26).reshape(2, 13).T)
    reduced = both.reduced({"first": both.point(0, "x")}, 12_000.0)
    alone = ElasticBody(mass, stiffness).reduced({"first": np.eye(13)[0]}, 12_000.0)
    assert reduced.controllable_body.size == alone.size < reduced.size
    np.testing.assert_allclose(
        ElasticBody(reduced.controllable_body.mass, reduced.controllable_body.stiffness).frequencies(1e5),
        ElasticBody(alone.mass, alone.stiffness).frequencies(1e5),
        rtol=1e-6,
    )


def test_damping_is_reduced_with_the_same_shapes():
    mass, stiffness, nodes = rod()
    body = ElasticBody(mass, stiffness, 1e-6 * stiffness, nodes)
    reduced = body.reduced(end_ports(body), 12_000.0)
    np.testing.assert_allclose(reduced.damping, 1e-6 * reduced.stiffness, atol=1e-12 * reduced.stiffness.max())


def test_bodies_of_equal_matrices_are_equal_so_that_a_plant_is_compiled_once():
    mass, stiffness, nodes = rod()
    first, second = (ElasticBody(mass, stiffness, nodes=nodes) for _ in range(2))
    assert first.reduced(end_ports(first), 6000.0) == second.reduced(end_ports(second), 6000.0)
    assert hash(first.reduced(end_ports(first), 6000.0)) == hash(second.reduced(end_ports(second), 6000.0))
    assert first.reduced(end_ports(first), 6000.0) != first.reduced(end_ports(first), 0.0)


def test_matrices_come_from_matrix_market_and_mat_files(tmp_path):
    mass, stiffness, nodes = rod()
    mmwrite(tmp_path / "k.mtx", stiffness)
    savemat(tmp_path / "all.mat", {"M": mass.tocsc(), "K": stiffness.tocsc(), "title": "rod"})
    body = ElasticBody.from_files(tmp_path / "all.mat", tmp_path / "k.mtx", names={"mass": "M"}, nodes=nodes)
    np.testing.assert_allclose(body.frequencies(20_000.0), ElasticBody(mass, stiffness, nodes=nodes).frequencies(20_000.0), rtol=1e-9)
    for arguments, words in (
        ({"mass": tmp_path / "all.mat"}, "holds `M`, `K`"),
        ({"mass": tmp_path / "all.mat", "names": {"mass": "m"}}, "holds no matrix `m`"),
        ({"mass": tmp_path / "none.mtx"}, "no file"),
        ({"mass": tmp_path / "k.csv"}, "must end in"),
        ({"mass": tmp_path / "k.mtx", "names": {"mass": "M"}}, "without a name"),
    ):
        with pytest.raises(SceneError, match=words):
            ElasticBody.from_files(**{"stiffness": tmp_path / "k.mtx"} | arguments)


@pytest.mark.parametrize("name", ["bad.mtx", "bad.mat"])
def test_damaged_files_are_refused_by_name(tmp_path, name):
    (tmp_path / name).write_bytes(b"%%MatrixMarket matrix coordinate real general\n3 3 2\n1 1 what")
    with pytest.raises(SceneError, match=name):
        ElasticBody.from_files(tmp_path / name, tmp_path / name)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"mass": np.eye(3)[:2]}, "square"),
        ({"mass": np.diag([1.0, 0.0, 1.0])}, "> 0 kg on its diagonal"),
        ({"stiffness": np.eye(2)}, "must have 3 rows"),
        ({"stiffness": np.array([[1.0, 2.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])}, "symmetric"),
        ({"stiffness": np.full((3, 3), np.nan)}, "finite"),
        ({"stiffness": np.zeros((3, 3))}, "other than 0"),
        ({"damping": np.eye(4)}, "must have 3 rows"),
        ({"nodes": [[0.0], [1.0]]}, "dof_map"),
        ({"dof_map": [[0], [0], [1]]}, "at most once"),
        ({"dof_map": [[0], [1], [3]]}, "at most once"),
        ({"faces": {"top": [0.0, 0.0, 0.0]}}, "not all 0"),
        ({"faces": {"top": [1.0]}}, r"`faces.top` must be finite numbers >= 0 of the shape \(3,\)"),
    ],
)
def test_what_is_no_body_is_refused(changes, words):
    with pytest.raises(SceneError, match=words):
        ElasticBody(**{"mass": np.eye(3), "stiffness": np.eye(3)} | changes)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"ports": {}}, "at least one port"),
        ({"ports": {"a": np.ones(5)}}, r"of the shape \(61,\)"),
        ({"ports": {"a": np.eye(61)[0], "b": 2 * np.eye(61)[0]}}, "independent"),
        ({"band": -1.0}, "band"),
        ({"tolerance": 0.0}, "tolerance"),
    ],
)
def test_a_reduction_refuses_what_it_cannot_do(arguments, words):
    mass, stiffness, nodes = rod()
    body = ElasticBody(mass, stiffness, nodes=nodes)
    with pytest.raises(SceneError, match=words):
        body.reduced(**{"ports": end_ports(body)} | arguments)


def test_unknown_faces_ports_axes_and_nodes_are_named():
    mass, stiffness, nodes = rod()
    body = ElasticBody(mass, stiffness, nodes=nodes, faces={"tip": np.eye(61)[60]})
    for ask, words in (
        (lambda: body.face_nodes("tap"), "did you mean"),
        (lambda: body.point(61, "x"), "0 to 60"),
        (lambda: body.point(0, "y"), "one of x"),
        (lambda: body.clamped(range(61)), "a part of the body free"),
        (lambda: body.reduced(end_ports(body)).index("lift"), "no port"),
        (lambda: body.reduced(end_ports(body)).indices("row"), "no ports"),
    ):
        with pytest.raises(SceneError, match=words):
            ask()


# ------------------------------------------------------------------------------------------------------------------------------- from meshes
def test_without_scikit_fem_the_extra_is_named(monkeypatch):
    from models import block_mesh

    monkeypatch.setitem(__import__("sys").modules, "skfem", None)
    with pytest.raises(SceneError, match=r"pip install -e .\.\[fe\]"):
        block_mesh((1.0, 1.0), (1, 1))


def test_a_block_with_linear_displacements_has_even_stress():
    """The patch test: inner nodes of distorted elements stay where a constant strain puts them, and the face carries an even traction."""
    from models import block_mesh, body_of_mesh

    mesh = block_mesh((1.0, 1.0, 1.0), (3, 3, 3))
    points = np.array(mesh.p)
    inside = ((points > 0.01) & (points < 0.99)).all(axis=0)
    points[:, inside] += 0.08 * np.sin(np.arange(3 * inside.sum())).reshape(3, -1)
    mesh = type(mesh)(points, mesh.t).with_boundaries({"top": lambda x: x[2] > 1 - 1e-9})
    body = body_of_mesh(mesh, density=1.0, modulus=1.0, poisson=0.3)
    strain = np.array([[-0.3, 0.1, 0.0], [0.0, -0.3, 0.2], [0.0, 0.0, 1.0]])
    linear = np.zeros(body.size)
    linear[body.dof_map] = body.nodes @ strain.T
    force = (body.stiffness @ linear)[body.dof_map]
    np.testing.assert_allclose(force[inside], 0.0, atol=1e-14)
    symmetric = (strain + strain.T) / 2
    lame, shear = 0.3 / (1.3 * 0.4), 1 / 2.6
    stress = lame * np.trace(symmetric) * np.eye(3) + 2 * shear * symmetric
    flat = body.faces["top"] > 0
    flat &= ((body.nodes[:, :2] > 0.01) & (body.nodes[:, :2] < 0.99)).all(axis=1)
    np.testing.assert_allclose(force[flat], np.outer(body.faces["top"][flat], stress[2]), atol=1e-14)


def test_a_body_from_a_mesh_has_the_mass_the_faces_and_the_six_rigid_motions_of_its_block():
    from models import block_mesh, body_of_mesh

    body = body_of_mesh(block_mesh((0.03, 0.02, 0.01), (3, 2, 2)), **STEEL)
    assert body.mass.sum() == pytest.approx(3 * 7800.0 * 6e-6)
    assert {name: float(areas.sum()) for name, areas in body.faces.items()} == pytest.approx(
        {"left": 2e-4, "right": 2e-4, "back": 3e-4, "front": 3e-4, "bottom": 6e-4, "top": 6e-4}
    )
    held = {f"{axis}.{i}": body.point(node, axis) for i, node in enumerate(body.face_nodes("bottom")) for axis in "xyz"}
    for ports in ({"top": body.mean("top", "x")}, held):
        reduced = body.reduced(ports, 150e3)
        assert reduced.rigid_body_modes == 6
        assert (ElasticBody(reduced.mass, reduced.stiffness).frequencies(1e9) == 0).sum() == 6
        assert reduced.frequency_errors.max() <= 0.01


def test_a_mesh_comes_from_a_file_with_its_named_boundaries(tmp_path):
    from models import block_mesh, body_of_mesh

    mesh = block_mesh((0.02, 0.01), (4, 2))
    mesh.save(str(tmp_path / "pad.msh"))
    body = body_of_mesh(tmp_path / "pad.msh", **STEEL, thickness=0.5)
    assert body.mass.sum() == pytest.approx(2 * 7800.0 * 1e-4)
    assert body.faces["top"].sum() == pytest.approx(0.02 * 0.5)
    (tmp_path / "bad.msh").write_text("no mesh")
    for name, words in (("none.msh", "no file"), ("bad.msh", "bad.msh")):
        with pytest.raises(SceneError, match=words):
            body_of_mesh(tmp_path / name, **STEEL)


@pytest.mark.parametrize("numbers", [{"poisson": 0.5}, {"modulus": 0.0}, {"density": math.nan}, {"damping_time": -1.0}, {"thickness": 0.0}])
def test_materials_that_are_none_are_refused(numbers):
    from models import block_mesh, body_of_mesh

    with pytest.raises(SceneError, match=next(iter(numbers))):
        body_of_mesh(block_mesh((1.0, 1.0), (1, 1)), **STEEL | numbers)


def test_sizes_materials_bands_and_mounts_may_be_text_with_units():
    from models import block_mesh, body_of_mesh

    typed = body_of_mesh(
        block_mesh(("10 mm", "5 mm"), (2, 1)), density="7.8 g/cm3", modulus="210 GPa", damping_time="1 us", thickness="20 mm"
    )
    plain = body_of_mesh(block_mesh((0.01, 0.005), (2, 1)), **STEEL, damping_time=1e-6, thickness=0.02)
    ports = {"left": typed.mean("left", "x")}
    assert typed.frequencies("400 kHz") == pytest.approx(plain.frequencies(4e5))
    first = typed.reduced(ports, "400 kHz").mounted({"left": ("10 N/mm", "5 N s/mm")})
    second = plain.reduced(ports, 4e5).mounted({"left": (1e4, 5e3)})
    for word in ("mass", "damping", "stiffness"):
        wanted = getattr(second, word)
        np.testing.assert_allclose(getattr(first, word), wanted, atol=1e-9 * np.abs(wanted).max())
    for changes, words in (({"density": "7.8 kg"}, "density"), ({"modulus": "210 GN"}, "modulus"), ({"thickness": "20"}, "thickness")):
        with pytest.raises(SceneError, match=words):
            body_of_mesh(block_mesh((0.01, 0.005), (2, 1)), **STEEL | changes)
    for mount in (("10 N/mm",), ("10 N", 0.0), (1.0, 2.0, 3.0), 5.0, (-1.0, 0.0), "10"):
        with pytest.raises(SceneError, match="left"):
            first.mounted({"left": mount})
    with pytest.raises(SceneError, match="size"):
        block_mesh(("10 kg", "5 mm"), (2, 1))
    with pytest.raises(SceneError, match="band"):
        plain.frequencies("4 m")


def test_a_large_free_body_has_its_six_rigid_motions_in_any_band_and_none_of_its_own_in_a_low_one():
    from models import block_mesh, body_of_mesh

    body = body_of_mesh(block_mesh((0.01,) * 3, (6, 6, 6)), **STEEL)
    assert body.size > 600
    for band in (0.0, 1.0, 1e5):
        assert (body.frequencies(band) == np.zeros(6)).all()
    low, high = (body.reduced({"top": body.mean("top", "x")}, band) for band in (0.0, 1.6e5))
    assert (low.rigid_body_modes, low.modes) == (6, 5)  # the motions that one port does not hold
    assert high.modes > low.modes
    assert high.frequency_errors.max() <= 0.01


def test_hundreds_of_ports_are_reduced_like_few():
    mass, stiffness, nodes = rod(700)
    body = ElasticBody(mass, stiffness, nodes=nodes)
    reduced = body.reduced({f"x.{i}": body.point(i, "x") for i in range(640)}, 12_000.0)
    assert reduced.size >= 640
    assert reduced.rigid_body_modes == 1
    assert reduced.frequency_errors.max() <= 0.01
