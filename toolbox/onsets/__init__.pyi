from .severity_map import BorderPoints as BorderPoints
from .severity_map import SeverityMap as SeverityMap
