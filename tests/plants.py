"""The plants that most tests share: the drill string of two inertias on its rock, and the block on a belt, as their models declare them."""

from models import BitRock, BlockOnBelt, wells
from toolbox import compose

RIG = compose(wells.JANSEN_2, BitRock())
BELT = compose(BlockOnBelt())
