"""The command `stickslip`, also as `python -m toolbox`: interrupts are looked after before anything is imported that takes long."""

import os
import signal
from typing import NoReturn


def script() -> NoReturn:
    """Run the command line as a process."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy is loaded: see `Workers`
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # until there is somebody who has words for it
    from toolbox.commands.interrupt import Watch

    watch = Watch()
    watch.begin()
    from toolbox.commands.command_line import script as run

    run(watch)


if __name__ == "__main__":
    script()
