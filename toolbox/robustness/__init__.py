"""How far a closed loop is from failing: margins at steady running, the best that any law can have, and the worst case of the machine itself."""

from typing import TYPE_CHECKING

from toolbox.faces import face

if TYPE_CHECKING:
    from toolbox.robustness.absorber import absorber_limit as absorber_limit
    from toolbox.robustness.charts import StabilityChart as StabilityChart
    from toolbox.robustness.charts import stability_chart as stability_chart
    from toolbox.robustness.depth_windows import Windows as Windows
    from toolbox.robustness.depth_windows import windows as windows
    from toolbox.robustness.describing import DescribingFunction as DescribingFunction
    from toolbox.robustness.describing import describing_function as describing_function
    from toolbox.robustness.groups import Group as Group
    from toolbox.robustness.groups import Machine as Machine
    from toolbox.robustness.groups import Varying as Varying
    from toolbox.robustness.groups import machine_groups as machine_groups
    from toolbox.robustness.joint_errors import SmallestError as SmallestError
    from toolbox.robustness.joint_errors import smallest_error as smallest_error
    from toolbox.robustness.limits import performance_limit as performance_limit
    from toolbox.robustness.lowest_set_point import Held as Held
    from toolbox.robustness.lowest_set_point import LowestSetPoints as LowestSetPoints
    from toolbox.robustness.margins import Margins as Margins
    from toolbox.robustness.responses import FrequencyResponse as FrequencyResponse
    from toolbox.robustness.responses import frequency_response as frequency_response
    from toolbox.robustness.worst_case import WorstCase as WorstCase
    from toolbox.robustness.worst_case import cycle_phases as cycle_phases

__getattr__, __dir__ = face()
