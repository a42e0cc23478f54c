"""Blocks on a moving belt: one block, the smallest machine with stick-slip, a chain of them, and an absorber that calms one."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca

from models.friction import Hyperbolic
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, SceneError, quantity, state
from toolbox.authoring import entries, number
from toolbox.modelling import Quantities


@dataclass(frozen=True)
class Block(Component):
    """Mass on a spring, without friction: m v' = u + a - k x - c v.

    Symbols and their fields: m `mass` [kg], k `stiffness` [N/m], c `damping` [N s/m].

    - Needs the signals `block.force` u [N] (default 0) and `block.attachment` a [N] (default 0), the force of an
      attached part: a friction damper, an absorber, a bristle.
    - Gives the signals `block.position` x [m], `block.speed` v [m/s].

    Examples
    --------
    >>> from models import Block
    >>> from toolbox import compose
    >>> print(compose(Block()))
    HybridSystem(Block): 2 states (block.position, block.speed); contacts: none; inputs: block.force [N], block.attachment [N]
    """

    mass: Quantity = quantity(1.0, "kg", "mass of the block", above=0)
    stiffness: Quantity = quantity(1.0, "N/m", "stiffness of the spring", at_least=0)
    damping: Quantity = quantity(0.0, "N s/m", "viscous damping to ground", at_least=0)

    def equations(self, signal):
        x, v = state("block.position", "m"), state("block.speed", "m/s")
        force, attachment = signal("block.force", "N", default=0.0), signal("block.attachment", "N", default=0.0)
        return Equations(
            flow={x: v, v: (force + attachment - self.stiffness * x - self.damping * v) / self.mass},
            stored=self.mass * v**2 / 2 + self.stiffness * x**2 / 2,
            losses={"damping": self.damping * v**2},
            supplies={"force": force * v, "attachment": attachment * v},
        )


@dataclass(frozen=True)
class BlockOnBelt(Component):
    """Block on a moving belt, held by a spring: m v' = u + a - k x - c v - d (v - v_belt) + F.

    Symbols and their fields: m `mass` [kg], k `stiffness` [N/m], c `damping` [N s/m], d `drag` [N s/m], v_belt
    `belt_speed` [m/s].

    F is the dry friction of the belt on the block. It depends on the slip speed v - v_belt.

    - Needs the signals `block.force` u [N] (default 0), `block.load` [N] (default: the field `load`) and
      `block.attachment` a [N] (default 0), the force of an attached part. To vary the load in time, give the input
      `block.load`.
    - Gives the signals `block.position` x [m], `block.speed` v [m/s].
    - Contact: `belt`.

    The default parameters give stick-slip with an amplitude of about 1 m. The block sticks while |k x| <= F_s, the
    static friction force. With belt speed 0 the model is the oscillator of J. P. Den Hartog (1931).

    Source: Leine et al., Nonlinear Dynamics 16 (1998) 41-54 (default parameters).

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose
    >>> print(compose(BlockOnBelt()))
    HybridSystem(BlockOnBelt): 2 states (block.position, block.speed); contacts: belt; inputs: block.force [N], block.load [N], block.attachment [N]
    """

    mass: Quantity = quantity(1.0, "kg", "mass of the block", above=0, source="Leine et al. (1998)")
    stiffness: Quantity = quantity(1.0, "N/m", "stiffness of the spring", at_least=0, source="Leine et al. (1998)")
    damping: Quantity = quantity(0.0, "N s/m", "viscous damping to ground", at_least=0)
    drag: Quantity = quantity(0.0, "N s/m", "viscous drag between block and belt", at_least=0)
    belt_speed: Quantity = quantity(0.2, "m/s", "speed of the belt", source="Leine et al. (1998)")
    load: Quantity = quantity(1.0, "N", "normal load; 1 if the friction law is a force", at_least=0)
    friction: FrictionLaw = Hyperbolic(static=1.0, decay=3.0)

    def equations(self, signal):
        x, v = state("block.position", "m"), state("block.speed", "m/s")
        force = signal("block.force", "N", default=0.0)
        load = signal("block.load", "N", default=self.load)
        attachment = signal("block.attachment", "N", default=0.0)
        slip = v - self.belt_speed
        belt = DryFriction("belt", slip, self.friction, load)
        carried = belt.force - self.drag * slip
        return Equations(
            flow={x: v, v: (force + attachment - self.stiffness * x - self.damping * v + carried) / self.mass},
            elements=[belt],
            stored=self.mass * v**2 / 2 + self.stiffness * x**2 / 2,
            losses={"friction": -belt.force * slip, "damping": self.damping * v**2, "drag": self.drag * slip**2},
            supplies={"belt drive": carried * self.belt_speed, "force": force * v, "attachment": attachment * v},
        )


@dataclass(frozen=True)
class GuideContact(Component):
    """Second friction surface on a block: a guide, a seal, or a slide with bristles. It exerts the force a = F on the block.

    F is dry friction with the slip speed v - v_belt, where v_belt is the speed of the surface (`belt_speed`, 0 by default).

    - Needs the signals `block.speed` v [m/s] and `guide.load` [N] (default: the field `load`).
    - Gives the signals `guide.drag` -F [N] and `block.attachment` a [N].
    - Contact: `guide`.

    If the block is also on a belt, one of the two friction laws must be a law with memory, such as `Dahl` or `LuGre`. A
    block with two dry frictions raises an error, because it is not determined which friction holds which part of the
    force at rest.

    The default values are examples without a source.

    Source: textbook.

    Examples
    --------
    >>> from models import Block, GuideContact
    >>> from toolbox import compose
    >>> print(compose(Block(), GuideContact()))
    HybridSystem(Block, GuideContact): 2 states (block.position, block.speed); contacts: guide; inputs: block.force [N], guide.load [N]
    """

    load: Quantity = quantity(1.0, "N", "normal load; 1 if the friction law is a force", at_least=0)
    belt_speed: Quantity = quantity(0.0, "m/s", "speed of the surface")
    friction: FrictionLaw = Hyperbolic(static=1.0, decay=3.0)

    def equations(self, signal):
        v = signal("block.speed", "m/s")
        guide = DryFriction("guide", v - self.belt_speed, self.friction, signal("guide.load", "N", default=self.load))
        return Equations(
            outputs={"guide.drag": (-guide.force, "N"), "block.attachment": (guide.force, "N")},
            elements=[guide],
            losses={"friction": -guide.force * (v - self.belt_speed)},
            supplies={"drive": guide.force * self.belt_speed, "block": -guide.force * v},
        )


@dataclass(frozen=True)
class BlocksOnBelt(Component):
    """Blocks in a row on one belt, each with a spring to ground and springs to its neighbours.

        m_i v_i' = u_i - k_i x_i - c_i v_i + q_i (x_(i+1) - x_i) - q_(i-1) (x_i - x_(i-1)) + F_i

    Symbols and their fields: m_i `mass` [kg], k_i `stiffness` [N/m], c_i `damping` [N s/m], q_i `tie` [N/m], v_belt
    `belt_speed` [m/s]. The n blocks are counted from 0. q_i joins the blocks i and i+1, so `tie` has n-1 entries. All
    other tuples have n entries.

    F_i is dry friction with the slip speed v_i - v_belt. This is the smallest plant in which several contacts stick at
    different times.

    - Needs the signals `blocks.force.i` u_i [N] (default 0), i from 0.
    - Gives the signals `blocks.position` x (n) [m] and `blocks.speed` v (n) [m/s].
    - Contacts: `belt.i`.

    Two equal blocks with equal start values move like one block alone. The default values are examples: two blocks of 1
    kg and 1.2 kg on springs of 1 N/m, with a soft spring between them. Friction and belt speed are the default values
    of `BlockOnBelt` (Leine et al.).

    Examples
    --------
    >>> from models import BlocksOnBelt
    >>> from toolbox import compose
    >>> print(compose(BlocksOnBelt()))
    HybridSystem(BlocksOnBelt): 4 states (blocks.position, blocks.speed); contacts: belt.0, belt.1; inputs: blocks.force.0 [N], blocks.force.1 [N]
    """

    mass: Quantities = quantity((1.0, 1.2), "kg", "masses", above=0)
    stiffness: Quantities = quantity((1.0, 1.0), "N/m", "stiffness to ground of every block", at_least=0)
    damping: Quantities = quantity((0.0, 0.0), "N s/m", "viscous damping to ground of every block", at_least=0)
    tie: Quantities = quantity((0.5,), "N/m", "stiffness q between neighbours", at_least=0)
    load: Quantities = quantity((1.0, 1.0), "N", "normal load of every block; 1 if the friction law is a force", at_least=0)
    belt_speed: Quantity = quantity(0.2, "m/s", "speed of the belt")
    friction: FrictionLaw = Hyperbolic(static=1.0, decay=3.0)

    def check(self):
        n = len(self.mass)
        if n < 2:
            raise SceneError(f"Argument `blocks.mass` must hold at least 2 masses, but it has {n}.")
        for name, size in (("stiffness", n), ("damping", n), ("load", n), ("tie", n - 1)):
            entries(f"blocks.{name}", getattr(self, name), size, f" for {n} blocks")

    def equations(self, signal):
        n = len(self.mass)
        x, v = state("blocks.position", "m", n), state("blocks.speed", "m/s", n)
        mass, stiffness, damping, tie = (ca.vertcat(*entries) for entries in (self.mass, self.stiffness, self.damping, self.tie))
        belts = [DryFriction(f"belt.{i}", v[i] - self.belt_speed, self.friction, self.load[i]) for i in range(n)]
        friction = ca.vertcat(*[belt.force for belt in belts])
        force = ca.vertcat(*[signal(f"blocks.force.{i}", "N", default=0.0) for i in range(n)])
        stretch = x[1:] - x[:-1]
        tied = ca.vertcat(tie * stretch, 0) - ca.vertcat(0, tie * stretch)
        return Equations(
            flow={x: v, v: (force + tied - stiffness * x - damping * v + friction) / mass},
            elements=belts,
            stored=ca.dot(mass, v**2) / 2 + ca.dot(stiffness, x**2) / 2 + ca.dot(tie, stretch**2) / 2,
            losses={"damping": ca.dot(damping, v**2)} | {f"friction {i}": -belt.force * belt.slip for i, belt in enumerate(belts)},
            supplies={"belt drive": ca.sum1(friction) * self.belt_speed, "force": ca.dot(force, v)},
        )


@dataclass(frozen=True)
class Absorber(Component):
    """Dynamic vibration absorber on a block: m_a w' = k_a (x - y) + c_a (v - w).

    Symbols and their fields: m_a `mass` [kg], k_a `stiffness` [N/m], c_a `damping` [N s/m].

    x and v are position and speed of the block, y and w are position and speed of the absorber mass. The force of
    spring and damper acts on the block with the opposite sign.

    - Needs the signals `block.position` x [m] and `block.speed` v [m/s].
    - Gives the signals `absorber.position` y [m], `absorber.speed` w [m/s] and `block.attachment` [N].
    - With `attached_to="pad"` the absorber is attached to the pads of a `DiscBrake`: `pad.position`, `pad.speed` and
      `pad.attachment` replace the signals of the block.

    `Absorber.tuned` returns an absorber with which a block stays at rest under large negative damping.

    This model is a reconstruction: Maegawa and Itoigawa studied an oscillator on an elastic foundation with an
    absorber, but their full paper was not available. The default values fit a block of 1 kg on a spring of 1 N/m.

    Examples
    --------
    >>> from models import Absorber, BlockOnBelt
    >>> from toolbox import compose
    >>> print(compose(BlockOnBelt(), Absorber()))
    HybridSystem(BlockOnBelt, Absorber): 4 states (block.position, block.speed, absorber.position, absorber.speed); contacts: belt; inputs:
      block.force [N], block.load [N]
    """

    mass: Quantity = quantity(0.1, "kg", "mass of the absorber", above=0)
    stiffness: Quantity = quantity(0.0909091, "N/m", "stiffness to the block", at_least=0)
    damping: Quantity = quantity(0.0287480, "N s/m", "viscous damping to the block", at_least=0)
    attached_to: str = "block"

    @staticmethod
    def tuned(block: Block | BlockOnBelt, mass_ratio: float) -> Absorber:
        """Return the absorber with which a block stays at rest under a large negative damping.

        With w_n = sqrt(k / m) of the block and the mass ratio e, the frequency of the absorber is w_n / sqrt(1 + e) and
        its damping ratio is sqrt(e / (1 + e)) / 2. By the Hurwitz criterion the block is then stable for all negative
        damping ratios up to `Absorber.max_negative_damping(e)`, where both pole pairs reach the imaginary axis
        together.

        Another absorber of the same mass can tolerate at most sqrt((1 + e)(1 - 1 / sqrt(1 + e)) / 2). This limit is
        larger than sqrt(e) / 2 by the factor 1 + e / 8 to first order. But with an absorber that reaches this limit the
        block is stable only in a narrow range of negative damping near the limit, not for all smaller values.

        Parameters
        ----------
        block
            The `Block` or `BlockOnBelt`.
        mass_ratio
            Mass of the absorber as a fraction e > 0 of the mass of the block.

        Returns
        -------
        Absorber
            The tuned absorber.

        Raises
        ------
        SceneError
            Unless e > 0 and the block has a spring.
        """
        number("mass_ratio", mass_ratio, above=0)
        number("block.stiffness", block.stiffness, "N/m", above=0)
        mass = mass_ratio * block.mass
        w = math.sqrt(block.stiffness / block.mass / (1 + mass_ratio))
        ratio = math.sqrt(mass_ratio / (1 + mass_ratio)) / 2
        return Absorber(mass=mass, stiffness=mass * w**2, damping=2 * ratio * mass * w)

    @staticmethod
    def max_negative_damping(mass_ratio: float) -> float:
        """Return the largest amount of negative damping that `Absorber.tuned(block, e)` stabilises, as the damping ratio sqrt(e) / 2.

        Negative damping is a damping ratio below 0 of the block, such as friction that falls with speed gives. Its amount is
        the absolute value of this ratio. With the result zeta, steady sliding of a block on a belt is stable if
        -N mu'(v_belt) - c < 2 m w_n zeta, with the load N [N], the slope mu' [s/m] of the friction coefficient, the damping c
        [N s/m] and the mass m [kg] of the block, and w_n = sqrt(k / m) [rad/s].

        Parameters
        ----------
        mass_ratio
            Mass of the absorber as a fraction e of the mass of the block.

        Returns
        -------
        float
            The damping ratio [1], as a positive number.

        Raises
        ------
        SceneError
            Unless e > 0.
        """
        number("mass_ratio", mass_ratio, above=0)
        return math.sqrt(mass_ratio) / 2

    def equations(self, signal):
        y, w = state("absorber.position", "m"), state("absorber.speed", "m/s")
        x, v = signal(f"{self.attached_to}.position", "m"), signal(f"{self.attached_to}.speed", "m/s")
        pull = self.stiffness * (x - y) + self.damping * (v - w)
        return Equations(
            flow={y: w, w: pull / self.mass},
            outputs={f"{self.attached_to}.attachment": (-pull, "N")},
            stored=self.mass * w**2 / 2 + self.stiffness * (x - y) ** 2 / 2,
            losses={"damping": self.damping * (v - w) ** 2},
            supplies={self.attached_to: pull * v},
        )
