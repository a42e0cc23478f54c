"""Controllers with code of their own, written as C."""

from toolbox.export.law_text import Declared as Declared
from toolbox.export.law_text import written as written
