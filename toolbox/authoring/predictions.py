"""Predictions of a plant in machine code, and the time that is left for them."""

from toolbox.modelling.regularisation import regularised as regularised
from toolbox.prediction.rollout import Rollout as Rollout
from toolbox.prediction.rollout_loop import MOTION_KINDS as MOTION_KINDS
from toolbox.prediction.rollout_loop import Motion as Motion
from toolbox.prediction.rollout_loop import advance_interval as advance_interval
from toolbox.prediction.rollout_loop import advance_rollout as advance_rollout
from toolbox.simulation.deadline import time_left as time_left
