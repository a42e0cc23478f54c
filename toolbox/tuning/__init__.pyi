from .results import Tuned as Tuned
