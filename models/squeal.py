"""Squeal by mode coupling: constant friction alone makes a pad unstable where it couples two modes of nearly one frequency."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from models.friction import Coulomb
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, quantity, state
from toolbox.authoring import Result, check_fields, columns, entries, number
from toolbox.modelling import Quantities


@dataclass(frozen=True)
class SquealingPad(Component):
    """Pad on two inclined springs, pressed on a disc: the minimal model of squeal with two modes.

        m x'' + c x' + k_xx x + k_xy y = F ;   m y'' + c y' + k_xy x + k_yy y = 0 ;   F dry friction with slip speed x' - v_disc, load P + k_c y
        k_xx = sum k_i cos^2 a_i,   k_xy = sum k_i sin a_i cos a_i,   k_yy = k_c + sum k_i sin^2 a_i

    Symbols and their fields: m `mass` [kg], c `damping` [N s/m], k_i `stiffness` [N/m] and a_i `angle` [rad] of spring
    i, k_c `contact_stiffness` [N/m], P `preload` [N], v_disc `disc_speed` [m/s], mu coefficient of the friction law
    `friction` [1].

    x is the displacement along the disc and y into the disc. Both are counted from the pressed state at rest without
    friction.

    The friction F is proportional to the normal force, so sliding changes k_xy in the first equation to k_xy - mu k_c.
    The stiffness matrix is then not symmetric. Above `flutter_friction` two modes have the same frequency, and one of
    them takes energy from the disc. The vibration grows until the pad sticks, if damping is large enough as in the
    defaults. Otherwise it grows until contact is lost.

    - Gives the signals `pad.position` x [m], `pad.approach` y [m], `pad.speed` [m/s], `pad.approach_speed` [m/s],
      `pad.normal_force` P + k_c y [N].
    - Contact: `pad`.

    Range of validity: loss of contact is not modelled (`ElasticPad` can lift off). A run whose normal force falls below
    0 raises an error, so keep the preload P above k_c |y|.

    Defaults: the dimensionless pad with k_xx = k_yy = 2, k_xy = 1, which flutters for mu > 3/4. The default damping,
    preload and speed are examples.

    Source: Hoffmann, Fischer, Allgaier, Ostermeyer (2002).

    Examples
    --------
    >>> from models import SquealingPad
    >>> from toolbox import compose
    >>> print(compose(SquealingPad()))
    HybridSystem(SquealingPad): 4 states (pad.position, pad.approach, pad.speed, pad.approach_speed); contacts: pad; inputs: none
    """

    mass: Quantity = quantity(1.0, "kg", "mass of the pad", above=0)
    damping: Quantity = quantity(0.15, "N s/m", "viscous damping c along and across", at_least=0)
    stiffness: Quantities = quantity(
        (2 / 3 * (2 - math.sqrt(3)), 2 / 3 * (2 + math.sqrt(3))), "N/m", "stiffness of the springs", at_least=0
    )
    angle: Quantities = quantity((math.radians(150), math.radians(30)), "rad", "inclination of the springs to the disc")
    contact_stiffness: Quantity = quantity(4 / 3, "N/m", "stiffness k_c of the contact", at_least=0)
    preload: Quantity = quantity(10.0, "N", "normal force P at rest", at_least=0)
    disc_speed: Quantity = quantity(0.5, "m/s", "speed of the disc under the pad")
    friction: FrictionLaw = Coulomb(static=0.9, kinetic=0.9)

    def check(self):
        entries("pad.angle", self.angle, len(self.stiffness), ", one per spring")

    def equations(self, signal):
        x, y = state("pad.position", "m"), state("pad.approach", "m")
        v, w = state("pad.speed", "m/s"), state("pad.approach_speed", "m/s")
        k_xx, k_xy, k_yy = self._stiffness()
        normal = self.preload + self.contact_stiffness * y
        pad = DryFriction("pad", v - self.disc_speed, self.friction, normal, lift_off="ElasticPad")
        return Equations(
            flow={
                x: v,
                y: w,
                v: (pad.force - self.damping * v - k_xx * x - k_xy * y) / self.mass,
                w: (-self.damping * w - k_xy * x - k_yy * y) / self.mass,
            },
            outputs={"pad.normal_force": (normal, "N")},
            elements=[pad],
            stored=self.mass * (v**2 + w**2) / 2 + (k_xx * x**2 + 2 * k_xy * x * y + k_yy * y**2) / 2,
            losses={"friction": -pad.force * (v - self.disc_speed), "damping": self.damping * (v**2 + w**2)},
            supplies={"disc drive": pad.force * self.disc_speed},
        )

    def flutter_friction(self) -> float:
        """Compute the coefficient of friction above which steady sliding is unstable by flutter.

        The result is inf if sliding in this direction of the disc is stable for every coefficient.

            mu = [(k_xx - k_yy)^2 + 4 k_xy^2 + 2 (c^2 / m) (k_xx + k_yy)] / (4 |k_xy| k_c)

        The friction is constant. At the coefficient mu the frequencies of both modes become equal. The damping is equal
        in both directions and increases the coefficient.

        Raises
        ------
        SceneError
            If a number of the pad is out of its bounds, such as a negative stiffness.
        """
        check_fields(self)
        k_xx, k_xy, k_yy = self._stiffness()
        coupling = float(k_xy) * math.copysign(1.0, self.disc_speed)
        if self.disc_speed == 0 or self.contact_stiffness == 0 or coupling <= 1e-12 * (k_xx + k_yy):  # cos 90 deg is not quite 0
            return math.inf
        numerator = (k_xx - k_yy) ** 2 + 4 * k_xy**2 + 2 * self.damping**2 / self.mass * (k_xx + k_yy)
        return float(numerator / (4 * coupling * self.contact_stiffness))

    def modes(self, frictions) -> SquealModes:
        """Compute the complex eigenvalues of steady sliding as a function of the coefficient of constant friction.

        The eigenvalues s are the zeros of the determinant of

            m s^2 + c s + [[k_xx, k_xy - mu k_c sgn(v_disc)], [k_xy, k_yy]]

        The pad squeals if a growth rate is positive. Above `flutter_friction` both modes have one frequency, and one of
        them grows.

        Parameters
        ----------
        frictions
            Coefficients of friction, shape (n,), >= 0.

        Returns
        -------
        SquealModes
            Frequencies and growth rates of both modes at every coefficient. It prints as a table, and `plot` draws it.

        Raises
        ------
        SceneError
            If a coefficient is negative or not finite, or a number of the pad is out of its bounds.

        Examples
        --------
        >>> print(SquealingPad().modes((0.6, 0.9)))
        friction  mode 1 [Hz]  growth [1/s]  mode 2 [Hz]  growth [1/s]
        --------------------------------------------------------------
        0.6             0.198        -0.075       0.2487        -0.075
        0.9            0.2262       -0.2324       0.2262       0.08236  squeals
        Flutter from a friction of 0.7837 on
        """
        check_fields(self)
        mu = np.array([number("frictions", each, at_least=0) for each in np.ravel(frictions)])
        k_xx, k_xy, k_yy = (float(each) for each in self._stiffness())
        drawn = mu * self.contact_stiffness * math.copysign(1.0, self.disc_speed)
        # s^2 + c s / m = -lambda / m, with lambda an eigenvalue of the stiffness that friction has made unsymmetric
        middle, half = (k_xx + k_yy) / 2, np.emath.sqrt(((k_xx - k_yy) / 2) ** 2 + (k_xy - drawn) * k_xy + 0j)
        values = np.stack([middle - half, middle + half], axis=-1) / self.mass
        rate = self.damping / (2 * self.mass)
        roots: np.ndarray = np.emath.sqrt(rate**2 - values + 0j)
        roots = np.where(roots.imag < 0, -roots, roots) - rate
        order = np.lexsort((roots.real, np.round(np.abs(roots.imag), 9)), axis=-1)
        poles = np.take_along_axis(roots, order, axis=-1)
        return SquealModes(mu, np.abs(poles.imag) / (2 * math.pi), poles.real, self.flutter_friction())

    def _stiffness(self):
        """k_xx, k_xy, k_yy of springs and contact, of numbers or symbols."""
        springs = [(k, ca.cos(a), ca.sin(a)) for k, a in zip(self.stiffness, self.angle, strict=True)]
        k_xx = sum(k * cos * cos for k, cos, _ in springs)
        k_xy = sum(k * cos * sin for k, cos, sin in springs)
        return k_xx, k_xy, self.contact_stiffness + sum(k * sin * sin for k, _, sin in springs)


@dataclass(frozen=True)
class SquealModes(Result):
    """Complex eigenvalues of a pad over its friction: the result of `SquealingPad.modes`. `to_csv` writes the table.

    Attributes
    ----------
    friction
        Coefficients of friction, shape (n,).
    frequency, growth
        Frequencies [Hz] and growth rates [1/s] of both modes, shape (n, 2), by frequency.
    flutter
        Coefficient from which on a mode grows; inf for none.
    """

    friction: np.ndarray
    frequency: np.ndarray
    growth: np.ndarray
    flutter: float

    @property
    def squeals(self) -> np.ndarray:
        """Where a mode grows, shape (n,)."""
        return self.growth.max(axis=1) > 0

    def _table(self) -> tuple[list[str], list[list[Any]]]:
        """One row per coefficient of friction: frequency and growth rate of both modes."""
        headings = ["friction", *(f"mode {mode} {what}" for mode in (1, 2) for what in ("frequency [Hz]", "growth [1/s]")), "squeals"]
        return headings, [
            [float(mu), low, first, high, second, "yes" if loud else "no"]
            for mu, (low, high), (first, second), loud in zip(
                self.friction, self.frequency.tolist(), self.growth.tolist(), self.squeals, strict=True
            )
        ]

    def __str__(self) -> str:
        rows = [["friction", "mode 1 [Hz]", "growth [1/s]", "mode 2 [Hz]", "growth [1/s]"]]
        for mu, (low, high), (first, second), loud in zip(self.friction, self.frequency, self.growth, self.squeals, strict=True):
            rows.append([*(f"{each:.4g}" for each in (mu, low, first, high, second)), *(["squeals"] if loud else [])])
        lines = columns(rows, (0, 5), "")
        lines.insert(1, "-" * len(lines[0]))
        lines.append(
            f"Flutter from a friction of {self.flutter:.4g} on"
            if math.isfinite(self.flutter)
            else "No friction in this direction makes it flutter"
        )
        return "\n".join(lines)

    def plot(self, axes: Any = None) -> Any:
        """Draw frequencies and growth rates over the friction, with the squealing range in grey.

        Parameters
        ----------
        axes
            Two axes to draw into. By default a new figure.

        Returns
        -------
        array of axes
            The axes. `axes[0].figure.savefig("squeal.png")` writes the figure to a file.
        """
        from toolbox.authoring import name_axis, panels, paper

        with paper():
            axes = panels(2, 2.8) if axes is None else axes
            for ax, values, words, unit in zip(
                axes, (self.frequency, self.growth), ("frequency", "growth rate"), ("Hz", "1/s"), strict=True
            ):
                for mode, (color, style) in enumerate((("black", "-"), ("0.45", "--"))):
                    ax.plot(self.friction, values[:, mode], color=color, linestyle=style, label=f"mode {mode + 1}")
                if self.flutter < self.friction.max():
                    ax.axvspan(self.flutter, self.friction.max(), color="0.92", zorder=0, label="squeals")
                name_axis(ax.xaxis, "coefficient of friction", "1")
                name_axis(ax.yaxis, words, unit)
            axes[1].axhline(0.0, color="0.6", linewidth=0.8)
            axes[0].legend(frameon=False)
        return axes
