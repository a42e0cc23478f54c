"""An elastic slider whose contact lets go region by region, with every event located."""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from models.elastic.reduced_body import ReducedBody
from models.friction import Exponential
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, SceneError, quantity, state
from toolbox.authoring import entries
from toolbox.modelling import Quantities


@dataclass(frozen=True)
class ElasticSlider(Component):
    """Elastic body on a moving plate, with several friction contacts, held by a spring and a damper: M q'' + C q' + K q = forces on its ports.

    Each contact is a port of the reduced body (`contact.0`, `contact.1`, ...): the mean displacement of a node, a row
    or a patch along the plate. Each contact sticks and slips independently under its own constant normal load. The
    loads come from a static analysis: `ElasticBody.node_row_areas` times a pressure, or the normal forces of
    `toolbox.contacts.press_contacts`.

    The spring and the damper act on the port `support_port`. Their defaults and the default friction are the same as
    for `Slider`. The body may also have other ports, and modes.

    - Needs the signals `slider.pull` [N] (default 0) at `support_port` and `plate.speed` [m/s] (default 0).
    - Gives the signals `slider.position` [m] and `slider.speed` [m/s] of `support_port`, `plate.drag` [N], the friction
      of all contacts on the body, and `plate.stuck` [1], the fraction of the load on contacts that stick.
    - States: `slider.displacement` z and `slider.rate` q'.
    - Elements: `plate.i`, the contacts in order, with the modes "stick" and "slip+/-".

    In z the displacements of the contacts are counted from the displacement of `support_port`: q_c = z_c + z_held.
    Reason: strains are nanometres while the slider moves by millimetres, so round-off of the motion would appear as
    forces of the body. The energy balance of a cube on a plate closes to 2e-14 with z and to 6e-9 with q.

    Advice for elastic sliders, whose equations are stiff:

    - Give the material some damping. Otherwise the fastest mode rings through the whole run.
    - Keep only modes that the drive excites. A mode that stays at the size of round-off still needs short time steps.
      Modes that no port excites are left out automatically.

    Range of validity: small strains, loads that do not depend on the motion, about thirty contacts. For more contacts,
    or contacts that open, use `toolbox.contacts.step_contacts`.

    Examples
    --------
    >>> import numpy as np
    >>> from models import ElasticSlider, ReducedBody
    >>> from toolbox import compose
    >>> body = ReducedBody(("held", "contact.0"), np.eye(2), np.zeros((2, 2)), np.array([[1e6, -1e6], [-1e6, 1e6]]))
    >>> print(compose(ElasticSlider(body, loads=(10.0,))))
    HybridSystem(ElasticSlider): 4 states (slider.displacement, slider.rate); contacts: plate.0; inputs: slider.pull [N], plate.speed [m/s]
    """

    body: ReducedBody = field(metadata={"meaning": "the reduced body; in a scene file the path of its .npz, or a table of its attributes"})
    loads: Quantities = quantity(unit="N", meaning="normal load of every contact", at_least=0)
    support_port: str = "held"
    stiffness: Quantity = quantity(10_000.0, "N/m", "stiffness of the spring to ground", at_least=0)
    damping: Quantity = quantity(5000.0, "N s/m", "damping to ground", at_least=0)
    friction: FrictionLaw = Exponential(static=0.35, kinetic=0.25, decay=1.0)

    def check(self):
        if not isinstance(self.body, ReducedBody):
            raise SceneError(f"Argument `body` must be a ReducedBody, as `ElasticBody.reduced` makes it, but it is {self.body!r}.")
        entries("slider.loads", self.loads, len(self.body.indices("contact")), ", one for each contact")
        self.body.index(self.support_port)

    def equations(self, signal):
        body = self.body.controllable_body
        n, contacts, held = body.size, body.indices("contact"), body.index(self.support_port)
        shift = np.eye(n)  # q = shift z
        shift[[contact for contact in contacts if contact != held], held] = 1.0
        z, v = state("slider.displacement", "m", n), state("slider.rate", "m/s", n)
        pull, plate_speed = signal("slider.pull", "N", default=0.0), signal("plate.speed", "m/s", default=0.0)
        slips = [v[contact] - plate_speed for contact in contacts]
        plate = [DryFriction(f"plate.{i}", slip, self.friction, load) for i, (slip, load) in enumerate(zip(slips, self.loads, strict=True))]
        mount = pull - self.stiffness * z[held] - self.damping * v[held]
        elastic = _without_round_off(body.stiffness @ shift, held)
        strained = _without_round_off((shift.T @ elastic).T, held).T
        compliance, damping = np.linalg.inv(body.mass), ca.DM(body.damping)
        inner = -ca.DM(compliance @ elastic) @ z - ca.DM(compliance @ body.damping) @ v
        forces = ca.vertcat(mount, *(contact.force for contact in plate))
        drag = sum(contact.force for contact in plate)
        stuck = sum(load * (1 - contact.mode**2) for load, contact in zip(self.loads, plate, strict=True))
        return Equations(
            flow={z: ca.DM(np.linalg.inv(shift)) @ v, v: inner + ca.DM(compliance[:, [held, *contacts]]) @ forces},
            outputs={
                "slider.position": (z[held], "m"),
                "slider.speed": (v[held], "m/s"),
                "plate.drag": (drag, "N"),
                "plate.stuck": (stuck / sum(self.loads), "1"),
            },
            elements=plate,
            stored=(ca.bilin(ca.DM(body.mass), v, v) + ca.bilin(ca.DM(strained), z, z) + self.stiffness * z[held] ** 2) / 2,
            losses={
                "friction": -sum(contact.force * slip for contact, slip in zip(plate, slips, strict=True)),
                "damper": self.damping * v[held] ** 2,
                "material": ca.bilin(damping, v, v),
            },
            supplies={"pull": pull * v[held], "plate": drag * plate_speed},
        )


def _without_round_off(matrix: np.ndarray, held: int) -> np.ndarray:
    """The matrix without what round-off leaves of the forces of a common motion, in the column `held`."""
    found = matrix.copy()
    found[np.abs(found[:, held]) < 1e-13 * np.abs(matrix).max(), held] = 0.0
    return found
