"""Numbers of a law that do best, at one machine or over the depth of a well."""

from typing import TYPE_CHECKING

from toolbox.faces import face

if TYPE_CHECKING:
    from toolbox.tuning.gain_schedule import Schedule as Schedule
    from toolbox.tuning.gain_schedule import schedule as schedule
    from toolbox.tuning.results import Tuned as Tuned

__getattr__, __dir__ = face()
