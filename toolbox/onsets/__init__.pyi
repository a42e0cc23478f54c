from .severity_map import SeverityMap as SeverityMap
