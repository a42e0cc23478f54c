"""Parameters from measurements."""

from typing import TYPE_CHECKING

from toolbox.faces import face

if TYPE_CHECKING:
    from toolbox.calibration.recording import Recording as Recording
    from toolbox.calibration.results import Fit as Fit
    from toolbox.calibration.validation import Validation as Validation
    from toolbox.calibration.validation import validate as validate
    from toolbox.calibration.windows import MeasuredContact as MeasuredContact
    from toolbox.calibration.windows import Search as Search
    from toolbox.calibration.windows import Window as Window

__getattr__, __dir__ = face()
