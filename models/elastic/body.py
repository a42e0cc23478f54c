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
from toolbox.authoring import NumberOrText, array, finite_array, number, suggest

AXES = "xyz"


@dataclass(frozen=True, eq=False)
class ElasticBody:
    """A linear elastic body: M u'' + C u' + K u = f, with its nodes and the parts of its surface.

    A port is a weighted mean of displacements, w^T u: where a body is joined to something, a force F on the port loads it with w F. `point`, `mean` and
    `rows` make ports, `reduced` keeps them exactly.

    mass, stiffness: (n, n) symmetric matrices [kg], [N/m], dense or sparse (scipy).  damping: (n, n) matrix [N s/m]; None for none.
    nodes: (k, 1 to 3) coordinates [m]; None where they are not known.  entries: (k, axes) whole numbers, the entry of u that is the displacement of a node
    along an axis, -1 where the node is held; None for node by node, or, without nodes, one entry a node.  faces: {name: (k,) areas [m2] of a part of
    the surface that belong to each node, 0 away from it}. In a plane model lengths stand in place of areas.

    Raises SceneError for matrices that are not square, finite, symmetric and of one size, for a mass that is not positive on its diagonal, and for
    entries, nodes or faces that do not fit.  Source: textbook (finite elements).
    """

    mass: Any
    stiffness: Any
    damping: Any = None
    nodes: Any = None
    entries: Any = None
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
        made = {"mass": mass, "stiffness": stiffness, "damping": damping, "nodes": nodes, "entries": entries, "faces": faces}
        for word, value in made.items():
            object.__setattr__(self, word, value)

    def _placed(self, nodes: np.ndarray | None, n: int) -> np.ndarray:
        """The entries of the nodes, checked."""
        if self.entries is None:
            axes = 1 if nodes is None else nodes.shape[1]
            if nodes is not None and nodes.size != n:
                raise SceneError(
                    f"Argument `nodes` must come with `entries`, because {n} rows are not one for each of {nodes.size} coordinates."
                )
            return np.arange(n).reshape(-1, axes)
        entries = np.asarray(self.entries)
        if entries.dtype.kind not in "iu" or entries.ndim != 2 or (nodes is not None and len(nodes) != len(entries)):
            raise SceneError("Argument `entries` must be whole numbers, one row for each node and one column for each axis.")
        used = entries[entries >= 0]
        if used.size and (used.max() >= n or np.unique(used).size != used.size):
            raise SceneError(f"Argument `entries` must name every one of {n} rows at most once, but it does not.")
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
        """A body from files of a finite-element program: Matrix Market (.mtx, .mtx.gz) or MAT (.mat), one matrix each, in SI units.

        Parameters
        ----------
        mass, stiffness, damping
            Paths of the files; no damping without the last.
        names
            {"mass": name of the matrix in its MAT file, ...}, needed where a file holds several matrices.
        places
            nodes, entries and faces, as for `ElasticBody`.

        Raises
        ------
        SceneError
            Where a file cannot be read, or holds no matrix of that name, or several.
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
        """Entries of the displacement."""
        return int(self.mass.shape[0])

    def on(self, face: str) -> np.ndarray:
        """Numbers of the nodes of a face, ordered by x, then y, then z; raises SceneError for a face that the body has not."""
        if face not in self.faces:
            raise SceneError(f"There is no face `{face}`: {suggest(face, self.faces)}")
        found = np.flatnonzero(self.faces[face])
        return found if self.nodes is None else found[np.lexsort(np.round(self.nodes[found].T, 12)[::-1])]

    def clamped(self, nodes: str | Iterable[int], axes: str = AXES) -> ElasticBody:
        """Return the body with nodes, or all nodes of a face, held along axes such as "z" or "xyz" (axes of the body)."""
        chosen = self.on(nodes) if isinstance(nodes, str) else self._nodes(nodes)
        columns = [self._axis(axis) for axis in axes if axes != AXES or AXES.index(axis) < self.entries.shape[1]]
        held = self.entries[chosen][:, columns]
        free = np.ones(self.size, bool)
        free[held[held >= 0]] = False
        if not free.any():
            raise SceneError("Argument `nodes` must leave a part of the body free, but all of it is held.")
        number = np.append(np.where(free, np.cumsum(free) - 1, -1), -1)
        matrices = {word: getattr(self, word)[free][:, free] for word in ("mass", "stiffness", "damping")}
        return replace(self, **matrices, entries=number[self.entries])

    def point(self, node: int, axis: str) -> np.ndarray:
        """The port that is the displacement of one node along an axis; (n,)."""
        return self._weighted(np.array([node]), np.ones(1), axis)

    def mean(self, face: str, axis: str) -> np.ndarray:
        """The port that is the mean displacement of a face along an axis, weighted with area; a force on it is an even traction. Shape (n,)."""
        chosen = self.on(face)
        return self._weighted(chosen, self.faces[face][chosen], axis)

    def rows(self, face: str, along: str, axis: str) -> list[np.ndarray]:
        """Ports of the rows of a face: nodes with one coordinate `along` an axis, in its order; each the mean displacement of its row along `axis`."""
        return [self._weighted(row, self.faces[face][row], axis) for row in self._rows(face, along)]

    def row_areas(self, face: str, along: str) -> np.ndarray:
        """Areas [m2] of the rows of a face, as in `rows`: times a pressure, their normal loads on a smooth plate under even pressure."""
        return np.array([self.faces[face][row].sum() for row in self._rows(face, along)])

    def _rows(self, face: str, along: str) -> list[np.ndarray]:
        if self.nodes is None:
            raise SceneError("Argument `nodes` must be given for a body that is divided into rows.")
        chosen = self.on(face)
        place = self.nodes[chosen, self._axis(along)]
        _, row = np.unique(np.round(place / max(np.ptp(place), 1e-300), 9), return_inverse=True)
        return [chosen[row == i] for i in range(row.max() + 1)]

    def frequencies(self, band: NumberOrText) -> np.ndarray:
        """Natural frequencies [Hz] of the undamped body from 0 up to `band` [Hz], in rising order; rigid-body motions are zeros."""
        return natural_frequencies(self.mass, self.stiffness, number("band", band, "Hz", at_least=0))

    def reduced(self, ports: Mapping[str, np.ndarray], band: NumberOrText = 0.0, tolerance: float = 0.01) -> ReducedBody:
        """The body in a few coordinates: the displacements of its ports, and as many modes with held ports as the band needs (Craig and Bampton).

        ports: {name: (n,) weights w of the displacement w^T u}, linearly independent.  band [Hz]: every natural frequency of the body up to there is right
        within `tolerance` (relative); 0 for statics alone.  Statics under forces on ports are exact; rigid-body motions are kept. See `ReducedBody`.
        Raises SceneError for a band below 0, a tolerance that is not > 0 and < 1, and ports of another length or that depend on each other.
        """
        return reduce_body(self.mass, self.damping, self.stiffness, ports, number("band", band, "Hz", at_least=0), tolerance)

    def _weighted(self, nodes: np.ndarray, weights: np.ndarray, axis: str) -> np.ndarray:
        entries = self.entries[self._nodes(nodes), self._axis(axis)]
        if (entries < 0).all():
            raise SceneError(f"Argument `axis` must be one along which a node of the port is free, but all are held along {axis}.")
        port = np.zeros(self.size)
        np.add.at(port, entries[entries >= 0], weights[entries >= 0] / weights.sum())
        return port

    def _nodes(self, nodes: Iterable[int]) -> np.ndarray:
        chosen = np.asarray(list(nodes))
        if not chosen.size or chosen.dtype.kind not in "iu" or chosen.min() < 0 or chosen.max() >= len(self.entries):
            raise SceneError(f"Argument `nodes` must be numbers of nodes from 0 to {len(self.entries) - 1}, but it is {nodes!r}.")
        return chosen

    def _axis(self, axis: str) -> int:
        known = AXES[: self.entries.shape[1]]
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
