"""An elastic body whose face sticks, slips and opens contact by contact on a rigid plate, as scenes name it."""

from __future__ import annotations

from dataclasses import dataclass, field

from models.elastic.reduced_body import ReducedBody
from models.friction import Coulomb
from toolbox import FrictionLaw, Quantity, SceneError, quantity
from toolbox.authoring import check_fields
from toolbox.contacts import ContactBody, ContactProblem
from toolbox.modelling import OptionalQuantities


@dataclass(frozen=True)
class ElasticFace(ContactBody):
    """Elastic body on a rigid plate, with many contacts that have a Coulomb friction cone: M q'' + C q' + K q = forces on its ports.

    - A contact i consists of the ports whose names end with its number i. With `tangent` ("x", "y") and `normal` "z"
      these are the ports `x.i` and `y.i` along the plate and `z.i` perpendicular to the plate.
    - With `normal` the contacts open and close under the pressure that the motion gives. With `loads` in place of
      `normal` they stay closed under these constant normal loads.
    - A spring and a damper to ground may act on one port, `support_port`. For springs to ground on other ports use
      `ReducedBody.mounted`.

    Signals:

    - Needs `surface.x` and `surface.y`, the speeds of the plate along the tangents [m/s], and the ports in
      `force_ports`, each as a force on the body [N].
    - Gives all ports [m].

    Range of validity: small strains and small rotations; up to hundreds of contacts.

    Examples
    --------
    >>> import numpy as np
    >>> from models import ElasticFace, ReducedBody
    >>> body = ReducedBody(("x.0", "x.1"), np.eye(2), np.zeros((2, 2)), np.array([[1e6, -1e6], [-1e6, 1e6]]))
    >>> face = ElasticFace(body, tangent=("x",), loads=(5.0, 10.0))
    >>> print(face.problem().contacts, "contacts,", face.problem().size, "coordinates")
    2 contacts, 2 coordinates
    """

    body: ReducedBody = field(metadata={"meaning": "the reduced body; in a scene file the path of its .npz, or a table of its attributes"})
    tangent: tuple[str, ...] = field(
        metadata={"meaning": "one or two words: the ports word.0, word.1, ... are the displacements along the plate"}
    )
    normal: str | None = field(
        default=None, metadata={"meaning": "the word of the displacements off the plate, for contacts that open and close"}
    )
    loads: OptionalQuantities = quantity(None, "N", "given normal load of every contact, in place of `normal`", at_least=0)
    gap: OptionalQuantities = quantity(None, "m", "gap of every contact at q = 0; none without")
    normal_sign: Quantity = quantity(-1.0, "1", "-1 if a positive normal displacement opens the contact, 1 if it closes the contact")
    force_ports: tuple[str, ...] = field(default=(), metadata={"meaning": "ports on which forces act"})
    support_port: str | None = field(default=None, metadata={"meaning": "port on which spring and damper act"})
    support_stiffness: Quantity = quantity(0.0, "N/m", "spring to ground at `support_port`", at_least=0)
    support_damping: Quantity = quantity(0.0, "N s/m", "damper to ground at `support_port`", at_least=0)
    friction: FrictionLaw = Coulomb(0.35, 0.35)

    def check(self):
        if not isinstance(self.body, ReducedBody):
            raise SceneError(f"Argument `body` must be a ReducedBody, as `ElasticBody.reduced` makes it, but it is {self.body!r}.")
        if (self.normal is None) == (self.loads is None):
            raise SceneError("Either `normal` must be given, for contacts that open and close, or `loads`, and not both.")
        if self.support_port is None and (self.support_stiffness or self.support_damping):
            raise SceneError(
                "Arguments `support_stiffness` and `support_damping` must come with `support_port`, the port on which they act, but there is none."
            )

    def problem(self) -> ContactProblem:
        check_fields(self)
        body = (
            self.body
            if self.support_port is None
            else self.body.mounted({self.support_port: (self.support_stiffness, self.support_damping)})
        )
        return body.in_contact(
            self.friction,
            self.tangent,
            self.normal,
            normal_sign=self.normal_sign,
            load=self.loads,
            gap=self.gap,
            force_ports=self.force_ports,
        )
