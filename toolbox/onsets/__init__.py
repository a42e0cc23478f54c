"""Where stick-slip begins and where it ends."""

from typing import TYPE_CHECKING

from toolbox.faces import face

if TYPE_CHECKING:
    from toolbox.onsets.severity_map import SeverityMap as SeverityMap

__getattr__, __dir__ = face()
