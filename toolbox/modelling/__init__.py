"""Parts, laws, and the hybrid system that they make."""

from typing import TYPE_CHECKING

from toolbox.faces import face

if TYPE_CHECKING:
    from toolbox.modelling.elements import Hysteresis as Hysteresis
    from toolbox.modelling.elements import OptionalQuantities as OptionalQuantities
    from toolbox.modelling.elements import OptionalQuantity as OptionalQuantity
    from toolbox.modelling.elements import Quantities as Quantities
    from toolbox.modelling.laws import Takeover as Takeover
    from toolbox.modelling.observers import Observed as Observed
    from toolbox.modelling.observers import Observer as Observer
    from toolbox.modelling.regularisation import smoothed as smoothed
    from toolbox.modelling.relay import Relay as Relay
    from toolbox.modelling.remembering import Remembering as Remembering

__getattr__, __dir__ = face()
