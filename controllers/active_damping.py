"""Jansen's optimum: the drive as a spring and a damper that give the whole string equal, best damped poles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controllers.pi import PI
from controllers.torque_limits import TorqueLimits
from toolbox import Quantity, SceneError, quantity


@dataclass(frozen=True)
class ActiveDamping(TorqueLimits):
    """Speed controller that makes the drive a tuned vibration absorber of the bit: u = k_f int e dt + (c_f - c_r) e.

        k_f = k J_2 / J_1,   c_f = 2 sqrt(J_1 / J_2) om J_2,   om = sqrt(k / J_1)
        1: inertia below the drive, 2: inertia of the drive, k: stiffness of all springs in series, e = reference - top speed

    With these gains the four poles of the string and the drive form two equal pairs. Without drag and rock the
    characteristic polynomial is J_2 / J_1 (s^2 + sqrt(J_1 / J_2) om s + om^2)^2. No other gains k_f and c_f give the
    less damped pair more damping.

    u is the torque of the drive and e the error of the top speed. `design` reads k, J_1, J_2 and the drag c_r of the
    drive from the plant (`chain`) and returns a `PI` with these gains.

    Source: J. D. Jansen, L. van den Steen, J. Sound Vib. 179 (1995) 647-668.

    Examples
    --------
    >>> from controllers import ActiveDamping
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> print(closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), ActiveDamping(reference="60 rpm")))
    Closed loop: TorsionalChain, BitRock
      ActiveDamping, continuous: proportional 1579 N m s/rad, integral 2684 N m/rad, reference 60 rpm
    """

    reference: Quantity = quantity(8.0, "rad/s", "set-point of the top-drive speed", typical_range=(0.05, 40.0))

    @staticmethod
    def gains(stiffness: float, string_inertia: float, drive_inertia: float) -> tuple[float, float]:
        """Compute the gains for a two-inertia string.

        Parameters
        ----------
        stiffness
            Stiffness k of the spring [N m/rad].
        string_inertia
            Inertia J_1 below the drive [kg m2].
        drive_inertia
            Inertia J_2 of the drive [kg m2].

        Returns
        -------
        float, float
            k_f [N m/rad] and c_f [N m s/rad].
        """
        om = float(np.sqrt(stiffness / string_inertia))
        return stiffness * drive_inertia / string_inertia, 2.0 * float(np.sqrt(string_inertia / drive_inertia)) * om * drive_inertia

    def design(self, plant):
        """Return the `PI` with the gains for this plant.

        Raises SceneError if the plant has no chain of inertias, or if the drag of the drive is not below c_f.

        Parameters
        ----------
        plant
            The plant on which the controller is designed.
        """
        try:
            inertia, stiffness, drag = (plant.parameter(f"chain.{name}") for name in ("inertia", "stiffness", "top_drag"))
        except SceneError as error:
            raise SceneError(f"ActiveDamping is designed on a chain of inertias: {error}") from None
        spring, damper = self.gains(1.0 / float(np.sum(1.0 / stiffness)), float(np.sum(inertia[1:])), float(inertia[0]))
        if damper <= drag:
            raise SceneError(
                f"ActiveDamping needs a drive with less drag than the optimum of {damper:.6g} N m s/rad, but it has {drag:.6g}."
            )
        return PI(proportional=damper - drag, integral=spring, reference=self.reference, **self.limits)
