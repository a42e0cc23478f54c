"""An elastic slider whose contact lets go region by region, with every event located."""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from models.elastic.reduced_body import ReducedBody
from models.friction import Exponential
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantities, Quantity, SceneError, quantity, state


@dataclass(frozen=True)
class ElasticSlider(Component):
    """Elastic body on a moving plate with contacts in a row, held by a spring and a damper: M q'' + C q' + K q = forces on its ports.

    Each contact is a port of the reduced body, `contact.0`, `contact.1`, ...: the mean displacement of a node, a row or a patch along the plate. It sticks and
    slips on its own under its own normal load, which does not change: loads from statics (`ElasticBody.row_areas` times a pressure, or the
    normal forces of `toolbox.press_contacts`). The spring and the damper act on the port `held`; the body may have more ports, and modes.
    Signals: needs `slider.pull` [N] (0) at `held` and `plate.speed` [m/s] (0); gives `slider.position` [m] and `slider.speed` [m/s] of `held`,
    `plate.drag` [N], the friction of all contacts on the body, and `plate.stuck` [1], the share of the load on contacts that stick. States:
    `slider.displacement` z and `slider.rate` z', in which contacts are counted from `held`: q_c = z_c + z_held. Strains are nanometres where the slider
    moves by millimetres, so in q a tolerance and round-off of the motion would stand for forces of the body (a cube on a plate takes a
    fifth of the steps in z, and its energy balances to 1e-13 instead of 6e-9).
    Elements: `plate.i`, contacts in order, with modes "stick" and "slip+/-".
    The defaults of spring, damper and friction are those of `Slider`. Modes that no port moves are left out.
    Such a body is stiff: give its material some damping, else its fastest mode rings through the
    run, and take modes only where the drive moves them: one that a slow drive leaves at the size of round-off asks for short steps all the same.
    Range: small strain, loads that do not follow the motion, some thirty contacts; for more, and for contacts that open, `toolbox.step_contacts`.
    """

    body: ReducedBody = field(metadata={"meaning": "the reduced body; in a scene file the path of its .npz, or a table of its attributes"})
    loads: Quantities = quantity(unit="N", meaning="normal load of every contact", at_least=0)
    held: str = "held"
    stiffness: Quantity = quantity(10_000.0, "N/m", "stiffness of the spring to ground", at_least=0)
    damping: Quantity = quantity(5000.0, "N s/m", "damping to ground", at_least=0)
    friction: FrictionLaw = Exponential(static=0.35, kinetic=0.25, decay=1.0)

    def check(self):
        if not isinstance(self.body, ReducedBody):
            raise SceneError(f"Argument `body` must be a ReducedBody, as `ElasticBody.reduced` makes it, but it is {self.body!r}.")
        contacts = len(self.body.indices("contact"))
        if len(self.loads) != contacts:
            raise SceneError(f"Argument `slider.loads` must have {contacts} entries, one for each contact, but it has {len(self.loads)}.")
        self.body.index(self.held)

    def equations(self, signal):
        body = self.body.moved
        n, contacts, held = body.size, body.indices("contact"), body.index(self.held)
        shift = np.eye(n)  # q = shift z
        shift[[contact for contact in contacts if contact != held], held] = 1.0
        mass, damping, stiffness = (_shifted(matrix, shift, held) for matrix in (body.mass, body.damping, body.stiffness))
        z, w = state("slider.displacement", "m", n), state("slider.rate", "m/s", n)
        pull, plate_speed = signal("slider.pull", "N", default=0.0), signal("plate.speed", "m/s", default=0.0)
        slips = [(w[contact] if contact == held else w[contact] + w[held]) - plate_speed for contact in contacts]
        plate = [DryFriction(f"plate.{i}", slip, self.friction, load) for i, (slip, load) in enumerate(zip(slips, self.loads, strict=True))]
        mount = pull - self.stiffness * z[held] - self.damping * w[held]
        compliance = np.linalg.inv(mass)
        inner = -ca.DM(compliance @ stiffness) @ z - ca.DM(compliance @ damping) @ w
        forces = ca.vertcat(mount, *(contact.force for contact in plate))
        drag = sum(contact.force for contact in plate)
        stuck = sum(load * (1 - contact.mode**2) for load, contact in zip(self.loads, plate, strict=True))
        return Equations(
            flow={z: w, w: inner + ca.DM(compliance @ shift.T[:, [held, *contacts]]) @ forces},
            gives={
                "slider.position": (z[held], "m"),
                "slider.speed": (w[held], "m/s"),
                "plate.drag": (drag, "N"),
                "plate.stuck": (stuck / sum(self.loads), "1"),
            },
            elements=plate,
            stored=(ca.bilin(ca.DM(mass), w, w) + ca.bilin(ca.DM(stiffness), z, z) + self.stiffness * z[held] ** 2) / 2,
            losses={
                "friction": -sum(contact.force * slip for contact, slip in zip(plate, slips, strict=True)),
                "damper": self.damping * w[held] ** 2,
                "material": ca.bilin(ca.DM(damping), w, w),
            },
            supplies={"pull": pull * w[held], "plate": drag * plate_speed},
        )


def _shifted(matrix: np.ndarray, shift: np.ndarray, held: int) -> np.ndarray:
    """The matrix in the coordinates z, without what round-off leaves of the forces of a common motion."""
    found = shift.T @ matrix @ shift
    rest = np.abs(found[held]) < 1e-13 * np.abs(matrix).max()
    found[held, rest] = found[rest, held] = 0.0
    return found
