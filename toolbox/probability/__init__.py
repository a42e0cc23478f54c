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
    from toolbox.probability.ensemble import EnsembleFilter as EnsembleFilter
    from toolbox.probability.ensemble import Estimate as Estimate
    from toolbox.probability.ensemble import Knowledge as Knowledge
    from toolbox.probability.estimates import Detector as Detector
    from toolbox.probability.estimates import Estimates as Estimates
    from toolbox.probability.estimates import estimate as estimate
    from toolbox.probability.posteriors import Posterior as Posterior
    from toolbox.probability.posteriors import posterior as posterior
    from toolbox.probability.posteriors import windowed as windowed
    from toolbox.probability.results import Chance as Chance

__getattr__, __dir__ = face()
