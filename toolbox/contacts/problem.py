"""A linear body with many contacts that open, stick and slip.

    M q'' + C q' + K q = f(t) + sum over contacts of (-N_i n_i + T_i t_i)

    0 <= N_i ,   n_i q <= gap_i ,   N_i (gap_i - n_i q) = 0         no tension, no penetration
    |T_i| <= mu N_i ,   T_i = -mu N_i s_i / |s_i| where s_i != 0     Coulomb's cone, s_i = t_i q' - surface speed, in one or two directions

q: coordinates of the body, n_i: closure of contact i per coordinate, t_i: its one or two tangential displacements. Where loads are given, N_i is known and
nothing opens. What acts on the body are inputs in time: `force_inputs` and motions of the counter-surface, `surface_velocity`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from toolbox.arguments import array, symmetric
from toolbox.errors import SceneError, suggest
from toolbox.files.units import parse
from toolbox.modelling.components import check_fields
from toolbox.modelling.elements import FrictionLaw, fields_in_si
from toolbox.vocabulary import Renamed

STICK, SLIP, OPEN = 0, 1, 2
LEGEND = {STICK: "stick", SLIP: "slip", OPEN: "open"}


@dataclass(frozen=True, eq=False)
class ContactProblem(Renamed):
    """Linear body with c contacts of the same friction law, for `step_contacts`.

    The equations are in the documentation of the module `toolbox.contacts.problem`.

    Parameters
    ----------
    mass, stiffness
        Symmetric matrices of the body [kg], [N/m], shape (n, n), in any kind of coordinates. The mass may be singular.
    tangent
        Tangential displacements of every contact [m], shape (c, k, n), in k = 1 or 2 directions.
    friction
        The friction law, without jumps.
    normal
        Closure of every contact, the displacement that closes its gap [m], shape (c, n). Give either this or `load`.
    load
        Constant normal loads [N], >= 0, shape (c,), for contacts that do not open and close.
    damping
        Damping matrix [N s/m], shape (n, n). By default no damping.
    gap
        Initial gaps [m], shape (c,). By default 0.
    force_inputs
        {name of an input: force on the coordinates per unit of the input, shape (n,)}.
    surface_velocity
        {name of an input: tangential speed of the counter-surface at every contact per unit of the input, shape (c,
        k)}.
    outputs
        {name of an output: row of the displacement that can be read from a run, shape (n,)}.
    contact_positions
        Positions of the contacts [m], shape (c, 1 to 3), for pictures.
    contact_areas
        Area of every contact [m2], shape (c,), for pressures and fractions of the area. By default 1.
    units
        {input or output: unit}. By default N for a force, m/s for a motion of the counter-surface, and m for an output.
        If an input and an output have the same name, this is the unit of the input.

    Raises
    ------
    SceneError
        If arrays are not finite or do not fit each other, matrices are not symmetric, the mass is negative, or the
        friction law jumps.

    Examples
    --------
    >>> import numpy as np
    >>> from models import Coulomb
    >>> from toolbox.contacts import ContactProblem, press_contacts
    >>> down, along = np.array([[1.0, 0.0]]), np.array([[[0.0, 1.0]]])
    >>> block = ContactProblem(np.eye(2), np.diag([0.0, 100.0]), along, Coulomb(0.5, 0.5), normal=down, force_inputs={"press": down[0]})
    >>> print(press_contacts(block, {"press": 20.0}).normal[0], "N")
    [20.] N
    """

    mass: Any
    stiffness: Any
    tangent: Any
    friction: FrictionLaw
    normal: Any = None
    load: Any = None
    damping: Any = None
    gap: Any = None
    force_inputs: Mapping[str, Any] = field(default_factory=dict)
    surface_velocity: Mapping[str, Any] = field(default_factory=dict)
    outputs: Mapping[str, Any] = field(default_factory=dict)
    contact_positions: Any = None
    contact_areas: Any = None
    units: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        size = np.shape(self.stiffness)[0] if np.ndim(self.stiffness) == 2 else 0
        tangent = array("tangent", self.tangent, (None, range(1, 3), None))
        if not len(tangent):
            raise SceneError("Argument `tangent` must hold at least one contact, but it is empty.")
        count, directions, _ = tangent.shape
        if (self.normal is None) == (self.load is None):
            raise SceneError("Either `normal` must be given, for contacts that open and close, or `load`, for given loads.")
        usual = {"damping": np.zeros((size, size)), "gap": np.zeros(count), "contact_areas": np.ones(count)}
        shapes: dict[str, tuple[int | range, ...]] = {
            "mass": (size, size), "stiffness": (size, size), "damping": (size, size), "tangent": (count, directions, size), "normal": (count, size),
            "load": (count,), "gap": (count,), "contact_areas": (count,), "contact_positions": (count, range(1, 4)),
        }  # fmt: skip
        for word, shape in shapes.items():
            given = usual.get(word) if getattr(self, word) is None else getattr(self, word)
            least = 0.0 if word in ("load", "contact_areas") else None
            object.__setattr__(self, word, None if given is None else array(word, given, shape, least))
        for word, shape in (("force_inputs", (size,)), ("surface_velocity", (count, directions)), ("outputs", (size,))):
            object.__setattr__(self, word, {name: array(f"{word}[{name!r}]", given, shape) for name, given in getattr(self, word).items()})
        for name, unit in self.units.items():
            if not any(name in known for known in (self.force_inputs, self.surface_velocity, self.outputs)):
                raise SceneError(
                    f"Argument `units` names `{name}`: {suggest(name, [*self.force_inputs, *self.surface_velocity, *self.outputs])}"
                )
            parse(f"1 {unit}", unit, f"units.{name}")
        self._check()

    def _check(self) -> None:
        """Raise SceneError for matrices that are those of no body, and for a friction law that time stepping does not take."""
        for word in ("mass", "stiffness", "damping"):
            symmetric(word, getattr(self, word))
        if not self.contact_areas.any():
            raise SceneError("Argument `contact_areas` must be > 0 for one contact at least, but all are 0.")
        least = np.linalg.eigvalsh(self.mass)[0]
        if least < -1e-9 * np.abs(self.mass).max():
            raise SceneError(f"Argument `mass` must not be negative along any motion, but its least eigenvalue is {least:.3g}.")
        if not isinstance(self.friction, FrictionLaw):
            raise SceneError(f"Argument `friction` must be a friction law such as Coulomb(), but it is {self.friction!r}.")
        check_fields(self.friction)
        if self.friction.break_speeds() or self.friction.memory(2):
            raise SceneError(
                "Argument `friction` must be a law without breaks, which time stepping does not locate, and without memory, which it has not."
            )

    def unit(self, name: str) -> str:
        """Return the unit of an input, or of an output if no input has this name.

        Parameters
        ----------
        name
            Name of the input or output.
        """
        return self.units.get(name, "N" if name in self.force_inputs else "m/s" if name in self.surface_velocity else "m")

    def output_unit(self, name: str) -> str:
        """Return the unit of an output. If an input has the same name, `units` holds the unit of the input, and the unit of the output is m.

        Parameters
        ----------
        name
            Name of the output.
        """
        return "m" if name in self.force_inputs or name in self.surface_velocity else self.unit(name)

    @property
    def contacts(self) -> int:
        """Number of contacts."""
        return int(self.tangent.shape[0])

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return int(self.stiffness.shape[0])

    @property
    def directions(self) -> int:
        """Number of tangential directions of a contact, 1 or 2."""
        return int(self.tangent.shape[1])

    def displacements(self) -> np.ndarray:
        """Return the rows that give the displacements of all contacts from the coordinates, shape (m, n).

        The first rows are the closures, if contacts can open. Then follow the tangential displacements, contact by
        contact.
        """
        sliding = self.tangent.reshape(-1, self.size)
        return sliding if self.normal is None else np.vstack([self.normal, sliding])

    def coefficients(self) -> tuple[float, ca.Function]:
        """Return the coefficient of friction at rest, and the kinetic coefficient as a function of the slip speed [m/s]."""
        speed = ca.SX.sym("speed")
        return float(self.friction.breakaway()), ca.Function("sliding", [speed], [self.friction.sliding(speed)])


@dataclass(frozen=True)
class ContactBody(Renamed):
    """Body with many contacts, for scene files. Write your own body as a frozen dataclass: declare numbers with `quantity` and write `problem`.

    Scene files can name classes of a registered package, and classes of a file that is given with `--load`. See
    `ContactScene`.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> from models import Coulomb
    >>> from toolbox import Quantity, quantity
    >>> from toolbox.contacts import ContactBody, ContactProblem
    >>> @dataclass(frozen=True)
    ... class Cube(ContactBody):
    ...     mass: Quantity = quantity(2.0, "kg", "mass of the cube", above=0)
    ...
    ...     def problem(self):
    ...         return ContactProblem([[self.mass]], [[1e4]], [[[1.0]]], Coulomb(0.3, 0.3), load=[10.0], outputs={"back": [1.0]})
    >>> print(Cube().problem().contacts, "contact")
    1 contact
    """

    def __post_init__(self) -> None:
        fields_in_si(self)

    def check(self) -> None:
        """Raise SceneError if fields contradict each other. Bounds that are declared with `quantity` are checked without this method."""

    def problem(self) -> ContactProblem:
        """Return the matrices, contacts, inputs and outputs that the fields describe."""
        raise NotImplementedError
