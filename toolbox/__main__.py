"""`python -m toolbox` is the command `stickslip`."""

from toolbox.command_line import script

script()
