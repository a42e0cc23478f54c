"""A reduced elastic body: its matrices in the displacements of its ports and a few modes, as a value, a file, and a problem of contacts."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from toolbox import FrictionLaw, SceneError
from toolbox.authoring import (
    NumberOrText,
    Renamed,
    array,
    entries,
    is_finite_number,
    new_field,
    new_names_only,
    number,
    read_arrays,
    replaced,
    suggest,
    symmetric,
    whole,
)
from toolbox.contacts import ContactProblem

MATRICES = ("mass", "damping", "stiffness")


@dataclass(frozen=True, eq=False)
class ReducedBody(Renamed):
    """Elastic body in a few coordinates q, the displacements of its ports and amplitudes of modes: M q'' + C q' + K q = forces on the ports.

    `ElasticBody.reduced` makes such a body from finite elements. Matrices that another program has reduced can be given
    directly. Two reduced bodies with the same ports, matrices and contacts are equal. In a scene file a body is the
    path of a file that `save` has written, or a table of these attributes.

    Attributes
    ----------
    ports
        Names of the ports, whose displacements [m] are the first coordinates, in this order.
    mass, damping, stiffness
        Symmetric dense matrices [kg], [N s/m], [N/m], shape (q, q). The mass is positive definite.
    cutoff_frequency
        Frequency up to which modes were kept [Hz]; 0 for the static response alone.
    frequencies
        Natural frequencies of the full body up to `cutoff_frequency` [Hz], shape (f,), without rigid-body motions.
    frequency_errors
        Relative errors of these natural frequencies in the reduced body, shape (f,), >= 0.
    rigid_body_modes
        Number of rigid-body motions of the body.
    contact_positions, contact_areas
        Positions of the contacts [m], shape (c, 1 to 3), and area of each contact [m2], shape (c,), for pictures and
        pressures. None if they are not known.

    Raises
    ------
    SceneError
        If a name is not text or occurs twice, or if matrices are not finite, not symmetric, of different sizes, or too
        small for the ports.

    Examples
    --------
    >>> import numpy as np
    >>> from models import ReducedBody
    >>> body = ReducedBody(("tip",), np.diag([1.0, 0.5]), np.zeros((2, 2)), np.diag([1e6, 4e6]))
    >>> print(body.size, "coordinates,", body.modes, "mode,", "port", body.index("tip"))
    2 coordinates, 1 mode, port 0
    """

    ports: tuple[str, ...]
    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    cutoff_frequency: float = 0.0
    frequencies: np.ndarray = ()  # type: ignore[assignment]
    frequency_errors: np.ndarray = ()  # type: ignore[assignment]
    rigid_body_modes: int = 0
    contact_positions: np.ndarray | None = None
    contact_areas: np.ndarray | None = None

    def __post_init__(self) -> None:
        ports = tuple(self.ports) if isinstance(self.ports, (list, tuple)) else ()
        if not ports or not all(isinstance(port, str) and port.isprintable() and port for port in ports) or len(set(ports)) < len(ports):
            raise SceneError(f"Argument `ports` must be names of ports, at least one and each once, but it is {self.ports!r}.")
        object.__setattr__(self, "ports", ports)
        for word in MATRICES:
            object.__setattr__(self, word, self._matrix(word))
        roots = np.sqrt(np.maximum(np.diag(self.mass), 0.0))
        if not roots.all() or not _positive(self.mass / np.outer(roots, roots)):
            raise SceneError("Argument `mass` must be positive definite: a coordinate without mass has no motion of its own.")
        for word in ("frequencies", "frequency_errors"):
            object.__setattr__(self, word, array(word, getattr(self, word), (None,), 0.0))
        entries("frequency_errors", self.frequency_errors, len(self.frequencies), ", one for each frequency")
        for word, axes in (("contact_positions", 2), ("contact_areas", 1)):
            if getattr(self, word) is not None:
                object.__setattr__(self, word, array(word, getattr(self, word), (None,) * axes))
        object.__setattr__(self, "cutoff_frequency", number("cutoff_frequency", self.cutoff_frequency, "Hz", at_least=0))
        object.__setattr__(self, "rigid_body_modes", whole("rigid_body_modes", self.rigid_body_modes, 0))

    def _matrix(self, word: str) -> np.ndarray:
        matrix = array(word, getattr(self, word), (None, None))
        if matrix.shape[0] != matrix.shape[1]:
            raise SceneError(f"Argument `{word}` must be a square matrix, but it has the shape {matrix.shape}.")
        if len(matrix) < len(self.ports) or (word != "mass" and len(matrix) != len(self.mass)):
            rows = f"{len(self.mass)} rows, as `mass` has" if word != "mass" else f"at least {len(self.ports)} rows, one for each port"
            raise SceneError(f"Argument `{word}` must have {rows}, but it has {len(matrix)}.")
        return symmetric(word, matrix)

    def save(self, path: str | Path) -> Path:
        """Write the body to a file (.npz) and return the path of the file.

        `ReducedBody.load` and scene files read this file. For an exactly symmetric matrix it contains only the upper triangle.

        Parameters
        ----------
        path
            Path of the file.
        """
        path = _npz(path)
        arrays: dict[str, Any] = {
            spec.name: np.asarray(getattr(self, spec.name)) for spec in fields(self) if getattr(self, spec.name) is not None
        }
        arrays |= {word: np.triu(arrays[word]) for word in MATRICES if np.array_equal(arrays[word], arrays[word].T)}
        with replaced(path) as file:
            np.savez_compressed(file, **arrays)
        return path

    @classmethod
    def load(cls, path: str | Path) -> ReducedBody:
        """Read a body from a file that `ReducedBody.save` has written. Reading never executes code from the file.

        Raises SceneError if the file is missing, damaged, or holds no body.

        Parameters
        ----------
        path
            Path of the file.
        """
        path = _npz(path)
        found = {new_field(cls, name): array for name, array in read_arrays(path, "a reduced body").items()}
        known = [spec.name for spec in fields(cls)]
        needed = [name for name in known if name not in ("contact_positions", "contact_areas")]
        for name in (*found, *needed):
            if name not in found or name not in known:
                fault = "holds" if name in found else "lacks"
                raise SceneError(f"File `{path}` must be a reduced body with {', '.join(needed)}, but it {fault} `{name}`.")
        try:
            plain = {name: found[name].tolist() for name in ("ports", "cutoff_frequency", "rigid_body_modes")}
            whole = {word: _mirrored(found[word]) for word in MATRICES}
            return cls(**found | plain | whole)
        except SceneError as error:
            raise SceneError(f"File `{path}` must be a reduced body, but: {error}") from None

    @property
    def size(self) -> int:
        """Number of coordinates q: the number of ports plus the number of modes."""
        return len(self.mass)

    @property
    def modes(self) -> int:
        """Number of modes with fixed ports that the reduction kept: `size` minus the number of ports."""
        return self.size - len(self.ports)

    def index(self, port: str) -> int:
        """Return the index of the coordinate that is the displacement of a port. Raises SceneError if the body has no such port.

        Parameters
        ----------
        port
            Name of the port.
        """
        if port not in self.ports:
            raise SceneError(f"There is no port `{port}`: {suggest(port, self.ports)}")
        return self.ports.index(port)

    def indices(self, prefix: str) -> list[int]:
        """Return the coordinates of the ports `prefix.0`, `prefix.1` and so on, in order. Raises SceneError if no port has such a name.

        Parameters
        ----------
        prefix
            Beginning of the names of the ports, such as "contact" for `contact.0`, `contact.1` and so on.
        """
        found: list[int] = []
        while f"{prefix}.{len(found)}" in self.ports:
            found.append(self.ports.index(f"{prefix}.{len(found)}"))
        if not found:
            starts = {port.rpartition(".")[0] for port in self.ports} - {""}
            raise SceneError(f"There are no ports `{prefix}.0`, `{prefix}.1`, ...: {suggest(prefix, starts)}")
        return found

    @functools.cached_property
    def controllable_body(self) -> ReducedBody:
        """Return the body without modes that no force on its ports can move, such as modes that a symmetry keeps at rest.

        The motion of such modes in a simulation would be round-off.
        """
        p, size = len(self.ports), np.sqrt(np.diag(self.mass))
        links = np.abs(self.mass / np.outer(size, size)) + np.abs(self.damping) / max(np.abs(self.damping).max(), 1e-300)
        links += np.abs(self.stiffness) / np.abs(self.stiffness).max()
        reached = np.arange(self.size) < p
        while True:  # modes may be moved by way of others, through damping
            further = reached | (links[reached] > 1e-9).any(axis=0)
            if (further == reached).all():
                break
            reached = further
        kept = np.ix_(reached, reached)
        return replace(self, mass=self.mass[kept], damping=self.damping[kept], stiffness=self.stiffness[kept])

    def mounted(self, mounts: Mapping[str, tuple[NumberOrText, NumberOrText]]) -> ReducedBody:
        """Return the body with additional springs and dampers from ports to ground.

        `frequencies` and `frequency_errors` of the result still describe the body without these mounts.

        Parameters
        ----------
        mounts
            {port: (stiffness [N/m], damping [N s/m])}, both >= 0.

        Returns
        -------
        ReducedBody
            The body with the mounts.
        """
        if not isinstance(mounts, Mapping):
            raise SceneError(f"Argument `mounts` must map ports to (stiffness, damping), but it is {mounts!r}.")
        stiffness, damping = self.stiffness.copy(), self.damping.copy()
        for port, given in mounts.items():
            pair = given if isinstance(given, (tuple, list, np.ndarray)) and len(given) == 2 else (None, None)
            i = self.index(port)
            stiffness[i, i] += number(f"mounts.{port}", pair[0], "N/m", at_least=0)
            damping[i, i] += number(f"mounts.{port}", pair[1], "N s/m", at_least=0)
        return replace(self, stiffness=stiffness, damping=damping)

    @new_names_only
    def in_contact(
        self,
        friction: FrictionLaw,
        tangent: Sequence[str],
        normal: str | None = None,
        *,
        normal_sign: float = -1.0,
        load: Any = None,
        gap: Any = None,
        force_ports: Sequence[str] = (),
        contact_positions: Any = None,
        contact_areas: Any = None,
    ) -> ContactProblem:
        """Return the contact problem of the body on a rigid counter-surface, for `step_contacts`.

        The inputs of the problem are the speeds of the counter-surface along the tangents [m/s], `surface.<prefix>` for
        every prefix in `tangent`, and the forces on `force_ports`. The outputs are all ports.

        Parameters
        ----------
        friction
            The friction law.
        tangent
            One or two prefixes of port names. The ports `prefix.0`, `prefix.1`, ... are the tangential displacements of the
            contacts.
        normal
            Prefix of the ports of the normal displacements, for contacts that open and close. By default None: the
            contacts stay closed under `load`.
        normal_sign
            1 if a positive normal displacement closes the gap, -1 (default) if it opens the gap, such as the height
            above a plate.
        load
            Constant normal loads [N], shape (contacts,), if `normal` is None. By default None.
        gap
            Initial gaps of the contacts [m], shape (contacts,), for contacts that open and close. By default None: 0.
        force_ports
            Names of the ports on which external forces act, by default none. Each becomes an input of the same name
            [N].
        contact_positions, contact_areas
            Positions of the contacts [m], shape (contacts, 1 to 3), and their areas [m2], shape (contacts,). By default
            the values of the body.

        Returns
        -------
        ContactProblem
            The problem.
        """
        if isinstance(tangent, str):
            raise SceneError(f"Argument `tangent` must be a tuple of words, such as ({tangent!r},), but it is one text.")
        ways = [self.indices(word) for word in tangent]
        count = len(ways[0]) if ways else 0
        if not count or any(len(way) != count for way in ways):
            raise SceneError(f"Argument `tangent` must name ports of as many contacts in every direction, but it is {tuple(tangent)!r}.")
        if len(ways) > 2:
            raise SceneError(f"Argument `tangent` must be one or two words, but it is {tuple(tangent)!r}.")
        if len(set(tangent) | {normal}) <= len(ways):
            raise SceneError(f"Arguments `tangent` and `normal` must be words that differ, but they are {tuple(tangent)!r} and {normal!r}.")
        unit = np.eye(self.size)
        if not is_finite_number(normal_sign) or abs(normal_sign) != 1:
            raise SceneError(f"Argument `normal_sign` must be 1 or -1, but it is {normal_sign!r}.")
        if isinstance(force_ports, str):
            raise SceneError(f"Argument `force_ports` must be a tuple of ports, such as ({force_ports!r},), but it is one text.")
        closures = None
        if normal is not None:
            closures = normal_sign * unit[self.indices(normal)]
        return ContactProblem(
            self.mass,
            self.stiffness,
            np.stack([unit[way] for way in ways], axis=1),
            friction,
            normal=closures,
            load=load,
            damping=self.damping,
            gap=gap,
            force_inputs={port: unit[self.index(port)] for port in force_ports},
            surface_velocity={f"surface.{word}": np.tile(np.eye(len(ways))[i], (count, 1)) for i, word in enumerate(tangent)},
            outputs={port: unit[i] for i, port in enumerate(self.ports)},
            contact_positions=self.contact_positions if contact_positions is None else contact_positions,
            contact_areas=self.contact_areas if contact_areas is None else contact_areas,
        )

    @functools.cached_property
    def _content(self) -> tuple[Any, ...]:
        surface = tuple(None if array is None else (array.shape, array.tobytes()) for array in (self.contact_positions, self.contact_areas))
        return (self.ports, *(getattr(self, word).tobytes() for word in MATRICES), *surface)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ReducedBody) and self._content == other._content

    def __hash__(self) -> int:
        return hash(self._content)

    def __repr__(self) -> str:
        return f"ReducedBody({len(self.ports)} ports, {self.modes} modes, band {self.cutoff_frequency:g} Hz)"

    def __str__(self) -> str:
        worst = (
            f", frequencies up to {self.frequencies[-1]:.4g} Hz right within {100 * self.frequency_errors.max():.2g} %"
            if self.frequency_errors.size
            else ""
        )
        return f"{self.size} coordinates: {len(self.ports)} ports and {self.modes} modes{worst}; {self.rigid_body_modes} rigid-body motions"


def _positive(matrix: np.ndarray) -> bool:
    """Whether a symmetric matrix is positive definite."""
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return True


def _mirrored(matrix: np.ndarray) -> np.ndarray:
    """A matrix of a file, of which `save` may have kept the upper triangle alone."""
    if matrix.ndim != 2 or matrix.dtype.kind != "f" or matrix.shape[0] != matrix.shape[1] or np.tril(matrix, -1).any():
        return matrix
    return matrix + np.triu(matrix, 1).T


def _npz(path: str | Path) -> Path:
    if not isinstance(path, (str, Path)) or Path(path).suffix.lower() != ".npz":
        raise SceneError(f"The file of a reduced body must end in .npz, but it is `{path}`.")
    return Path(path)
