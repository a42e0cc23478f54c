"""An elastic body as finite elements leave it: sparse matrices, and where the entries of its displacement are."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from models.elastic.files import read_matrix
from models.elastic.reduced_body import ReducedBody
from models.elastic.reduction import reduce_body
from models.elastic.spectrum import natural_frequencies
from toolbox import SceneError
from toolbox.authoring import NumberOrText, Renamed, array, finite_array, number, suggest

AXES = "xyz"


@dataclass(frozen=True, eq=False)
class ElasticBody(Renamed):
    """Linear elastic body M u'' + C u' + K u = f from finite elements, with its nodes and the named parts of its surface.

    A port is a place at which the body is joined to other parts: a weighted mean w^T u of displacements, with weights
    w. A force F on the port loads the body with w F. The methods `point`, `mean` and `node_row_ports` make ports, and
    `reduced` keeps the motion of the ports exactly.

    Attributes
    ----------
    mass, stiffness
        Symmetric matrices M [kg] and K [N/m], shape (n, n), dense or sparse (scipy).
    damping
        Matrix C [N s/m], shape (n, n). None for no damping.
    nodes
        Coordinates of the nodes [m], shape (k, 1 to 3). None if they are not known.
    dof_map
        Integers, shape (k, axes): the index in u of the displacement of a node along an axis, -1 if the node is held.
        By default (None) u contains first all axes of node 0, then all axes of node 1, and so on. If `nodes` is None,
        too, entry i of u is the only displacement of node i.
    faces
        {name of a part of the surface: areas [m2] that belong to each node, shape (k,), 0 away from the part}. In a
        plane model lengths replace areas.

    Raises
    ------
    SceneError
        If the matrices are not square, finite, symmetric and of one size, if the mass is not positive on its diagonal,
        or if entries, nodes or faces do not fit.

    Notes
    -----
    Source: textbook (finite elements).

    Examples
    --------
    >>> import numpy as np
    >>> from models import ElasticBody
    >>> body = ElasticBody(mass=np.diag([1.0, 1.0]), stiffness=np.array([[2e6, -1e6], [-1e6, 1e6]]))
    >>> print(body.size, "displacements, natural frequencies", body.frequencies("1 kHz").round(1), "Hz")
    2 displacements, natural frequencies [ 98.4 257.5] Hz
    """

    mass: Any
    stiffness: Any
    damping: Any = None
    nodes: Any = None
    dof_map: Any = None
    faces: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        mass, stiffness = (_matrix(word, getattr(self, word)) for word in ("mass", "stiffness"))
        n = mass.shape[0]
        damping = _matrix("damping", self.damping, singular=True) if self.damping is not None else 0.0 * stiffness
        for word, matrix in (("stiffness", stiffness), ("damping", damping)):
            if matrix.shape[0] != n:
                raise SceneError(f"Argument `{word}` must have {n} rows, as `mass` has, but it has {matrix.shape[0]}.")
        if not (mass.diagonal() > 0).all():
            raise SceneError("Argument `mass` must be > 0 kg on its diagonal: an entry without mass has no motion of its own.")
        nodes = None if self.nodes is None else array("nodes", self.nodes, (None, range(1, 4)))
        entries = self._placed(nodes, n)
        faces = {name: array(f"faces.{name}", areas, (len(entries),), 0.0) for name, areas in self.faces.items()}
        empty = next((name for name, areas in faces.items() if not areas.any()), None)
        if empty is not None:
            raise SceneError(f"Argument `faces` must give `{empty}` areas that are not all 0.")
        made = {"mass": mass, "stiffness": stiffness, "damping": damping, "nodes": nodes, "dof_map": entries, "faces": faces}
        for word, value in made.items():
            object.__setattr__(self, word, value)

    def _placed(self, nodes: np.ndarray | None, n: int) -> np.ndarray:
        """The entries of the nodes, checked."""
        if self.dof_map is None:
            axes = 1 if nodes is None else nodes.shape[1]
            if nodes is not None and nodes.size != n:
                raise SceneError(
                    f"Argument `nodes` must come with `dof_map`, because {n} rows are not one for each of {nodes.size} coordinates."
                )
            return np.arange(n).reshape(-1, axes)
        entries = np.asarray(self.dof_map)
        if entries.dtype.kind not in "iu" or entries.ndim != 2 or (nodes is not None and len(nodes) != len(entries)):
            raise SceneError("Argument `dof_map` must be whole numbers, one row for each node and one column for each axis.")
        used = entries[entries >= 0]
        if used.size and (used.max() >= n or np.unique(used).size != used.size):
            raise SceneError(f"Argument `dof_map` must name every one of {n} rows at most once, but it does not.")
        return entries.astype(int)

    @classmethod
    def from_files(
        cls,
        mass: Path | str,
        stiffness: Path | str,
        damping: Path | str | None = None,
        *,
        names: Mapping[str, str] | None = None,
        **places: Any,
    ) -> ElasticBody:
        """Make a body from files of a finite-element program: Matrix Market (.mtx, .mtx.gz) or MAT (.mat), with one matrix each, in SI units.

        Parameters
        ----------
        mass, stiffness, damping
            Paths of the files. By default `damping` is None: the body has no damping.
        names
            {"mass", "stiffness" or "damping": name of the matrix in its MAT file}. Needed if a file holds several
            matrices; by default None.
        places
            The attributes `nodes`, `dof_map` and `faces` of the body, if they are known: coordinates of the nodes [m],
            shape (k, 1 to 3), indices of their displacements, and areas of named parts of the surface.

        Returns
        -------
        ElasticBody
            The body.

        Raises
        ------
        SceneError
            If a file cannot be read, or if it holds no matrix of the given name. Also if it holds several matrices and
            no name is given.
        """
        names = names or {}
        paths = {"mass": mass, "stiffness": stiffness} | ({} if damping is None else {"damping": damping})
        matrices = {word: read_matrix(path, names.get(word)) for word, path in paths.items()}
        try:
            return cls(**matrices, **places)
        except SceneError as error:
            raise SceneError(f"Body of {', '.join(f'`{path}`' for path in paths.values())}: {error}") from None

    @property
    def size(self) -> int:
        """Number of entries of the displacement u."""
        return int(self.mass.shape[0])

    def face_nodes(self, face: str) -> np.ndarray:
        """Return the indices of the nodes of a face, ordered by x, then y, then z.

        Raises SceneError if the body has no face of this name.

        Parameters
        ----------
        face
            Name of the face, a key of `faces`.
        """
        if face not in self.faces:
            raise SceneError(f"There is no face `{face}`: {suggest(face, self.faces)}")
        found = np.flatnonzero(self.faces[face])
        return found if self.nodes is None else found[np.lexsort(np.round(self.nodes[found].T, 12)[::-1])]

    def clamped(self, nodes: str | Iterable[int], axes: str = AXES) -> ElasticBody:
        """Return the body with some nodes, or all nodes of a face, held at rest along the given axes.

        Parameters
        ----------
        nodes
            Indices of the nodes, or the name of a face.
        axes
            Axes along which the nodes are held, by default "xyz" (all).
        """
        chosen = self.face_nodes(nodes) if isinstance(nodes, str) else self._nodes(nodes)
        columns = [self._axis(axis) for axis in axes if axes != AXES or AXES.index(axis) < self.dof_map.shape[1]]
        held = self.dof_map[chosen][:, columns]
        free = np.ones(self.size, bool)
        free[held[held >= 0]] = False
        if not free.any():
            raise SceneError("Argument `nodes` must leave a part of the body free, but all of it is held.")
        number = np.append(np.where(free, np.cumsum(free) - 1, -1), -1)
        matrices = {word: getattr(self, word)[free][:, free] for word in ("mass", "stiffness", "damping")}
        return replace(self, **matrices, dof_map=number[self.dof_map])

    def point(self, node: int, axis: str) -> np.ndarray:
        """Return the port that is the displacement of one node along an axis, as weights w of shape (n,).

        n is the number of displacements of the body.

        Parameters
        ----------
        node
            Index of the node, counted from 0.
        axis
            Axis of the displacement: "x", "y" or "z".
        """
        return self._weighted(np.array([node]), np.ones(1), axis)

    def mean(self, face: str, axis: str) -> np.ndarray:
        """Return the weights w, shape (n,), of the port w^T u: the mean displacement of a face along an axis, weighted by area.

        A force on this port is a uniform traction on the face.

        Parameters
        ----------
        face
            Name of the face, a key of `faces`.
        axis
            Axis of the displacement: "x", "y" or "z".
        """
        chosen = self.face_nodes(face)
        return self._weighted(chosen, self.faces[face][chosen], axis)

    def node_row_ports(self, face: str, along: str, axis: str) -> list[np.ndarray]:
        """Return one port for each row of nodes of a face, as a list of arrays of weights, each of shape (n,).

        n is the number of displacements of the body. The port of a row is the mean displacement of its nodes along `axis`.
        A row consists of the nodes with the same coordinate along the axis `along`. The rows are in the order of this
        coordinate.

        Parameters
        ----------
        face
            Name of the face, a key of `faces`.
        along
            Axis along which the rows follow each other: "x", "y" or "z".
        axis
            Axis of the displacement: "x", "y" or "z".
        """
        return [self._weighted(row, self.faces[face][row], axis) for row in self._rows(face, along)]

    def node_row_areas(self, face: str, along: str) -> np.ndarray:
        """Return the area [m2] of each row of nodes of a face, shape (rows,), in the order of `node_row_ports`.

        A row consists of the nodes of the face with the same coordinate along an axis. The area of a row times a pressure is
        the normal load of the row on a smooth plate under uniform pressure.

        Parameters
        ----------
        face
            Name of the face, a key of `faces`.
        along
            Axis along which the rows follow each other: "x", "y" or "z".
        """
        return np.array([self.faces[face][row].sum() for row in self._rows(face, along)])

    def _rows(self, face: str, along: str) -> list[np.ndarray]:
        if self.nodes is None:
            raise SceneError("Argument `nodes` must be given for a body that is divided into rows.")
        chosen = self.face_nodes(face)
        place = self.nodes[chosen, self._axis(along)]
        _, row = np.unique(np.round(place / max(np.ptp(place), 1e-300), 9), return_inverse=True)
        return [chosen[row == i] for i in range(row.max() + 1)]

    def frequencies(self, band: NumberOrText) -> np.ndarray:
        """Compute the natural frequencies [Hz] of the undamped body from 0 up to `band` [Hz], ascending. Rigid-body motions have frequency 0.

        Parameters
        ----------
        band
            Highest frequency that is computed [Hz], or text with a unit.
        """
        return natural_frequencies(self.mass, self.stiffness, number("band", band, "Hz", at_least=0))

    def reduced(self, ports: Mapping[str, np.ndarray], band: NumberOrText = 0.0, tolerance: float = 0.01) -> ReducedBody:
        """Return the body in a few coordinates (Craig-Bampton reduction).

        The coordinates are the displacements of the ports and the amplitudes of modes with fixed ports. The number of
        modes is as large as the accuracy up to `band` requires. The static response to forces on ports is exact, and
        rigid-body motions are kept.

        Parameters
        ----------
        ports
            {name: weights w of the displacement w^T u, shape (n,)}, linearly independent.
        band
            Frequency [Hz] up to which every natural frequency of the body is accurate. By default 0: only the static
            response is accurate.
        tolerance
            Relative error of these natural frequencies, by default 0.01.

        Returns
        -------
        ReducedBody
            The reduced body.

        Raises
        ------
        SceneError
            If the band is below 0, the tolerance is not > 0 and < 1, or ports have another length or depend on each
            other.
        """
        return reduce_body(self.mass, self.damping, self.stiffness, ports, number("band", band, "Hz", at_least=0), tolerance)

    def _weighted(self, nodes: np.ndarray, weights: np.ndarray, axis: str) -> np.ndarray:
        entries = self.dof_map[self._nodes(nodes), self._axis(axis)]
        if (entries < 0).all():
            raise SceneError(f"Argument `axis` must be one along which a node of the port is free, but all are held along {axis}.")
        port = np.zeros(self.size)
        np.add.at(port, entries[entries >= 0], weights[entries >= 0] / weights.sum())
        return port

    def _nodes(self, nodes: Iterable[int]) -> np.ndarray:
        chosen = np.asarray(list(nodes))
        if not chosen.size or chosen.dtype.kind not in "iu" or chosen.min() < 0 or chosen.max() >= len(self.dof_map):
            raise SceneError(f"Argument `nodes` must be numbers of nodes from 0 to {len(self.dof_map) - 1}, but it is {nodes!r}.")
        return chosen

    def _axis(self, axis: str) -> int:
        known = AXES[: self.dof_map.shape[1]]
        if not isinstance(axis, str) or len(axis) != 1 or axis not in known:
            raise SceneError(f"Argument `axis` must be one of {', '.join(known)}, but it is {axis!r}.")
        return known.index(axis)


def _matrix(word: str, given: Any, singular: bool = False) -> Any:
    """A symmetric matrix as scipy's CSR."""
    from scipy.sparse import csr_matrix, issparse

    dense = given.data if issparse(given) else given
    if finite_array(dense) is None or getattr(given, "ndim", np.ndim(given)) != 2:
        raise SceneError(f"Argument `{word}` must be a matrix of finite numbers, but it is {given!r}.")
    matrix = csr_matrix(given, dtype=float)
    if matrix.shape[0] != matrix.shape[1] or not matrix.shape[0]:
        raise SceneError(f"Argument `{word}` must be square, but it has the shape {matrix.shape}.")
    largest = abs(matrix).max()
    if not singular and not largest > 0:
        raise SceneError(f"Argument `{word}` must have entries other than 0, but it has none.")
    if abs(matrix - matrix.T).max() > 1e-8 * largest:
        raise SceneError(
            f"Argument `{word}` must be symmetric, but entries differ by {abs(matrix - matrix.T).max():.2g}: does its file hold one half only?"
        )
    return (matrix + matrix.T) / 2
