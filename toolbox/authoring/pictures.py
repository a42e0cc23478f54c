"""Figures in the style of the toolbox; these import matplotlib."""

from toolbox.figures.style import line_styles as line_styles
from toolbox.figures.style import name_axis as name_axis
from toolbox.figures.style import panels as panels
from toolbox.figures.style import paper as paper
