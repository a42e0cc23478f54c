"""Elastic bodies from meshes, by scikit-fem (the extra `fe`): linear elements with full integration."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from models.elastic.body import ElasticBody
from toolbox import SceneError
from toolbox.authoring import NumberOrText, finite_array, in_si, number, opened


def block_mesh(size: Sequence[NumberOrText], divisions: Sequence[int | Sequence[float]]) -> Any:
    """Make a mesh of a rectangular block, from the origin to `size`.

    The elements are bricks, or quadrilaterals if two sizes are given. The faces are named `left`, `right` (x),
    `back`, `front` (y, in three dimensions only), `bottom` and `top` (last axis).

    Parameters
    ----------
    size
        Two or three lengths of the block [m].
    divisions
        For each axis a number of elements of equal length, or the ends of the elements as fractions of the size, from
        0 to 1.

    Returns
    -------
    skfem.Mesh
        The mesh, for `body_of_mesh`.

    Raises
    ------
    SceneError
        If a size is not > 0, the divisions do not fit, or scikit-fem is not installed.

    Examples
    --------
    >>> from models import block_mesh
    >>> print(block_mesh((0.01, 0.01, 0.01), (4, 4, 4)).nelements)
    64
    """
    mesh = _skfem()
    lengths = finite_array(in_si(size, "m", "size"))
    if lengths is None or lengths.ndim != 1 or len(lengths) not in (2, 3) or not (lengths > 0).all() or len(divisions) != len(lengths):
        raise SceneError(
            f"Argument `size` must be 2 or 3 lengths > 0 m, with as many `divisions`, but they are {size!r} and {divisions!r}."
        )
    ticks = [length * _places(given) for length, given in zip(lengths, divisions, strict=True)]
    kind = mesh.MeshQuad if len(lengths) == 2 else mesh.MeshHex
    names = (("left", "right"), ("bottom", "top")) if len(lengths) == 2 else (("left", "right"), ("back", "front"), ("bottom", "top"))
    tiny = 1e-9 * lengths
    sides = {}
    for axis, (low, high) in enumerate(names):
        sides[low] = lambda x, axis=axis: x[axis] < tiny[axis]
        sides[high] = lambda x, axis=axis: x[axis] > lengths[axis] - tiny[axis]
    return kind.init_tensor(*ticks).with_boundaries(sides)


def body_of_mesh(
    mesh: Any,
    *,
    density: NumberOrText,
    modulus: NumberOrText,
    poisson: float = 0.3,
    damping_time: NumberOrText = 0.0,
    thickness: NumberOrText = 1.0,
) -> ElasticBody:
    """Make a homogeneous isotropic elastic body from a mesh.

    Displacements are linear in the elements, the mass is consistent, and two dimensions mean plane strain. Range:
    small strain. Full integration locks in bending of thin parts and near poisson = 0.5.

    Parameters
    ----------
    mesh
        Path of a mesh file in metres (read by meshio: Gmsh, Abaqus, VTK, ...), or a mesh of scikit-fem, of triangles,
        quadrilaterals, tetrahedra or bricks. Its named boundaries (physical groups of a file) become the faces of the
        body.
    density
        Density [kg/m3].
    modulus
        Young's modulus [Pa].
    poisson
        Poisson's ratio, > -1 and < 0.5, by default 0.3.
    damping_time
        Factor of stiffness-proportional damping [s]: C = damping_time K, by default 0.
    thickness
        Thickness of a plane body [m], by default 1.

    Returns
    -------
    ElasticBody
        The body.

    Raises
    ------
    SceneError
        If a number is out of range, a file cannot be read, the elements are of another kind, or scikit-fem is not
        installed.

    Examples
    --------
    >>> from models import block_mesh, body_of_mesh
    >>> cube = body_of_mesh(block_mesh((0.01, 0.01, 0.01), (2, 2, 2)), density=7800.0, modulus=2.1e11)
    >>> print(f"{cube.mass.sum() / 3.0 * 1e3:.1f} g")
    7.8 g
    """
    density, modulus = number("density", density, "kg/m3", above=0), number("modulus", modulus, "Pa", above=0)
    damping_time, thickness = number("damping_time", damping_time, "s", at_least=0), number("thickness", thickness, "m", above=0)
    poisson = number("poisson", poisson, above=-1, below=0.5)
    skfem = _skfem()
    from skfem.helpers import dot
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    if isinstance(mesh, (str, Path)):
        mesh = _read(skfem, Path(mesh))
    elements = {"MeshTri1": "ElementTriP1", "MeshQuad1": "ElementQuad1", "MeshTet1": "ElementTetP1", "MeshHex1": "ElementHex1"}
    kind = type(mesh).__name__
    if kind not in elements:
        raise SceneError(f"Argument `mesh` must be a path, or a mesh of linear elements ({', '.join(elements)}), but it is a {kind}.")
    scalar = getattr(skfem, elements[kind])()
    plane = thickness if mesh.dim() == 2 else 1.0
    basis = skfem.Basis(mesh, skfem.ElementVector(scalar))
    stiffness = plane * linear_elasticity(*lame_parameters(modulus, poisson)).assemble(basis)
    mass = plane * density * skfem.BilinearForm(lambda u, v, w: dot(u, v)).assemble(basis)
    area = skfem.LinearForm(lambda v, w: v)
    areas = {name: plane * area.assemble(skfem.FacetBasis(mesh, scalar, facets=name)) for name in (mesh.boundaries or {})}
    faces = {
        name: np.where(values > 1e-9 * values.max(), values, 0.0) for name, values in areas.items()
    }  # nodes beside a face get round-off
    return ElasticBody(mass, stiffness, damping_time * stiffness, mesh.p.T, basis.nodal_dofs.T.astype(int), faces)


def _places(given: Any) -> np.ndarray:
    if isinstance(given, (int, np.integer)) and not isinstance(given, bool) and given >= 1:
        return np.linspace(0.0, 1.0, int(given) + 1)
    places = finite_array(given)
    if (
        places is None
        or places.ndim != 1
        or len(places) < 2
        or places[0] != 0
        or abs(places[-1] - 1) > 1e-12
        or not (np.diff(places) > 0).all()
    ):
        raise SceneError(f"Argument `divisions` must be whole numbers >= 1, or places that rise from 0 to 1, but it holds {given!r}.")
    return places


def _read(skfem: Any, path: Path) -> Any:
    opened(path).close()  # no pipe or device, and not too large
    try:
        return skfem.Mesh.load(str(path))
    except SystemExit:  # what meshio does with a suffix that it does not know
        raise SceneError(f"`{path}` is no mesh file that meshio reads.") from None
    except Exception as error:  # the readers of many formats fail in as many ways
        raise SceneError(f"`{path}` is no sound mesh file: {error}") from None


def _skfem() -> Any:
    try:
        import skfem
    except ImportError:
        raise SceneError("Bodies from meshes need scikit-fem: pip install -e '.[fe]' in the folder of the toolbox.") from None
    return skfem
