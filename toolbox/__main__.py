"""`python -m toolbox` is the command `stickslip`."""

from toolbox.commands.command_line import script

script()
