"""Scenes, and their form as files."""

from typing import TYPE_CHECKING

from toolbox.faces import face

if TYPE_CHECKING:
    from toolbox.scenes.contact_scene import ContactScene as ContactScene
    from toolbox.scenes.differences import Differences as Differences
    from toolbox.scenes.work_precision import WorkPrecision as WorkPrecision

__getattr__, __dir__ = face()
