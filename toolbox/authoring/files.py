"""Files that are read and written, and results that are kept in them."""

from toolbox.files.archives import arrays as read_arrays  # noqa: F401 (public under this name)
from toolbox.files.atomic import replaced as replaced
from toolbox.files.mat import read_mat as read_mat
from toolbox.files.printing import columns as columns
from toolbox.files.printing import table as html_table  # noqa: F401 (public under this name)
from toolbox.files.reading import opened as opened
from toolbox.files.results import Result as Result
from toolbox.files.tables import Column as Column
from toolbox.files.tables import Table as Table
from toolbox.files.tables import read as read_table  # noqa: F401 (public under this name)
from toolbox.files.unit_systems import reading as reading
