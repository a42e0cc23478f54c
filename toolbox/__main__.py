"""`python -m toolbox` is the command `stickslip`."""

import sys

from toolbox.command_line import main

sys.exit(main())
