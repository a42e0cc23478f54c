"""Checks of what a user gives, and the fields of a part."""

from toolbox.arguments import array as array
from toolbox.arguments import entries as entries
from toolbox.arguments import finite_array as finite_array
from toolbox.arguments import is_finite_number as is_finite_number
from toolbox.arguments import number as number
from toolbox.arguments import numbers as numbers
from toolbox.arguments import symmetric as symmetric
from toolbox.arguments import whole as whole
from toolbox.errors import suggest as suggest
from toolbox.files.units import NumberOrText as NumberOrText
from toolbox.files.units import in_si as in_si
from toolbox.modelling.components import check_fields as check_fields
from toolbox.modelling.elements import State as State
from toolbox.vocabulary import Renamed as Renamed
from toolbox.vocabulary import new_field as new_field
from toolbox.vocabulary import new_names_only as new_names_only
