"""What does an event cost where every contact acts on every other?

Blocks rub on one cart that a spring holds and a force shakes: whatever a contact does moves the cart, and so the slip of all others. The matrix of the forces
that hold each other is full, its factors take n^3/3 operations and a solution with them n^2. Processor time of whole runs, per event, the least of
five; then the exponent from each size to the next, and the time to compose and compile anew.

    python -m studies blocks_on_cart
"""

from __future__ import annotations

import os
import tempfile
from dataclasses import dataclass

import casadi as ca
import numpy as np

from models import Coulomb
from studies.timing import timed
from toolbox import Component, DryFriction, Equations, HybridSystem, compose, quantity, simulate, state


@dataclass(frozen=True)
class BlocksOnCart(Component):
    """Blocks on a cart, each held to the ground by a spring of its own; M V' = push - K X - sum F_i,  m_i v_i' = F_i - k_i x_i, with a contact of bound
    static_i on v_i - V."""

    cart: float = quantity(5.0, "kg", "mass of the cart", above=0)
    spring: float = quantity(0.0, "N/m", "spring of the cart", at_least=0)
    mass: tuple[float, ...] = quantity((1.0, 1.0), "kg", "masses of the blocks", above=0)
    stiffness: tuple[float, ...] = quantity((0.0, 0.0), "N/m", "springs of the blocks", at_least=0)
    static: tuple[float, ...] = quantity((1.0, 1.0), "N", "static bounds of the contacts", at_least=0)
    kinetic: tuple[float, ...] = quantity((1.0, 1.0), "N", "kinetic friction of the contacts", at_least=0)

    def equations(self, signal):
        place, speed = state("cart.position", "m"), state("cart.speed", "m/s")
        x, v = state("blocks.position", "m", size=len(self.mass)), state("blocks.speed", "m/s", size=len(self.mass))
        n = len(self.mass)
        contacts = [DryFriction(f"block.{i}", v[i] - speed, Coulomb(static=self.static[i], kinetic=self.kinetic[i])) for i in range(n)]
        push = signal("cart.force", "N", default=0.0)
        pulls = [contact.force - self.stiffness[i] * x[i] for i, contact in enumerate(contacts)]
        flow = {place: speed, speed: (push - self.spring * place - sum(contact.force for contact in contacts)) / self.cart}
        return Equations(
            flow={**flow, x: v, v: ca.vertcat(*[pull / self.mass[i] for i, pull in enumerate(pulls)])},
            elements=contacts,
            stored=self.cart * speed**2 / 2 + self.spring * place**2 / 2
            + sum(self.mass[i] * v[i] ** 2 + self.stiffness[i] * x[i] ** 2 for i in range(n)) / 2,
            losses={"contacts": sum(-contact.force * (v[i] - speed) for i, contact in enumerate(contacts))},
            supplies={"force": push * speed},
        )  # fmt: skip


def shaken(n: int) -> HybridSystem:
    """n blocks of 5 kg together on a cart of 5 kg, with bounds and springs that differ from block to block."""
    random = np.random.default_rng(n)
    static = 4.0 / n * (0.5 + random.random(n))
    return compose(
        BlocksOnCart(spring=20.0, mass=(5.0 / n,) * n, stiffness=tuple(10.0 / n * (0.5 + random.random(n))), static=tuple(static),
                     kinetic=tuple(0.7 * static))
    )  # fmt: skip


def main() -> None:
    """Print the table."""
    grid = np.linspace(0.0, 20.0, 200)
    push = {"cart.force": (grid, 20.0 * np.sin(2.0 * grid))}
    print(f"{'n':>4}{'compile [s]':>13}{'events':>8}{'steps':>7}{'us an event':>13}{'exponent':>10}")
    before = None
    for n in (4, 8, 16, 32, 64):
        with tempfile.TemporaryDirectory() as empty:
            os.environ["STICKSLIP_CACHE_DIR"] = empty
            plants: list[HybridSystem] = []
            _, compiling = timed(lambda n=n, to=plants: (to.append(shaken(n)), simulate(to[0], 0.0, inputs=push)))
            del os.environ["STICKSLIP_CACHE_DIR"]
        run = simulate(plants[0], 20.0, inputs=push)
        each = 1e6 * timed(lambda p=plants[0]: simulate(p, 20.0, inputs=push), 5)[1] / len(run.events)
        exponent = f"{np.log2(each / before):10.1f}" if before else ""
        print(f"{n:>4}{compiling:>13.2f}{len(run.events):>8}{sum(run.steps):>7}{each:>13.1f}{exponent}", flush=True)
        before = each


if __name__ == "__main__":
    main()
