"""A local page that simulates a closed loop while its numbers are turned: traces, verdict, poles and the map around the working point."""

from typing import TYPE_CHECKING

from toolbox.faces import face

if TYPE_CHECKING:
    from toolbox.page.served import Page as Page
    from toolbox.page.served import explore as explore

__getattr__, __dir__ = face()
