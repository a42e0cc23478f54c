from .contact_scene import ContactScene as ContactScene
from .differences import Differences as Differences
from .work_precision import WorkPrecision as WorkPrecision
