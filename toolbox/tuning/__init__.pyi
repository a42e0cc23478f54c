from .gain_schedule import Schedule as Schedule
from .gain_schedule import schedule as schedule
from .results import Tuned as Tuned
