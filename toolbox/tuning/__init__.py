"""Numbers of a law that do best."""

from typing import TYPE_CHECKING

from toolbox.faces import face

if TYPE_CHECKING:
    from toolbox.tuning.results import Tuned as Tuned

__getattr__, __dir__ = face()
