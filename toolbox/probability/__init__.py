"""Chances in place of verdicts: numbers that are known as distributions, and what a machine then does, with bounds."""

from typing import TYPE_CHECKING

from toolbox.faces import face

if TYPE_CHECKING:
    from toolbox.probability.basins import Basin as Basin
    from toolbox.probability.basins import basin as basin
    from toolbox.probability.chances import chance as chance
    from toolbox.probability.distributions import Draws as Draws
    from toolbox.probability.distributions import LogNormal as LogNormal
    from toolbox.probability.distributions import Normal as Normal
    from toolbox.probability.distributions import Uniform as Uniform
    from toolbox.probability.distributions import drawn as drawn
    from toolbox.probability.distributions import drawn_group as drawn_group
    from toolbox.probability.drawn_borders import UncertainOnset as UncertainOnset
    from toolbox.probability.drawn_borders import uncertain_onset as uncertain_onset
    from toolbox.probability.ensemble import EnsembleFilter as EnsembleFilter
    from toolbox.probability.ensemble import Estimate as Estimate
    from toolbox.probability.ensemble import Knowledge as Knowledge
    from toolbox.probability.estimates import Detector as Detector
    from toolbox.probability.estimates import Estimates as Estimates
    from toolbox.probability.estimates import estimate as estimate
    from toolbox.probability.model_comparison import ModelComparison as ModelComparison
    from toolbox.probability.model_comparison import compare_models as compare_models
    from toolbox.probability.posteriors import Posterior as Posterior
    from toolbox.probability.posteriors import from_recording as from_recording
    from toolbox.probability.posteriors import posterior as posterior
    from toolbox.probability.posteriors import windowed as windowed
    from toolbox.probability.predictions import Prediction as Prediction
    from toolbox.probability.predictions import predict as predict
    from toolbox.probability.results import Chance as Chance

__getattr__, __dir__ = face()
