"""Parameters from measurements."""

from typing import TYPE_CHECKING

from toolbox.faces import face

if TYPE_CHECKING:
    from toolbox.calibration.recording import Recording as Recording
    from toolbox.calibration.results import Fit as Fit

__getattr__, __dir__ = face()
