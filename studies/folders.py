"""Where studies draw: into the folder that the command line names, else into `studies/figures`."""

from __future__ import annotations

import sys
from pathlib import Path


def figure_folder() -> Path:
    """The folder, which is made where it is not there; from here on figures are drawn without a screen."""
    import matplotlib

    matplotlib.use("Agg")
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("figures")
    folder.mkdir(parents=True, exist_ok=True)
    return folder
