from .identified import Identification as Identification
from .recording import Recording as Recording
from .results import Fit as Fit
from .validation import Validation as Validation
from .validation import validate as validate
from .windows import MeasuredContact as MeasuredContact
from .windows import Search as Search
from .windows import Window as Window
