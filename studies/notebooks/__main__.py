"""Build the notebooks: every script of this folder, in percent format, is run and written as .ipynb with its pictures.

    python -m studies.notebooks [NAME ...]           (needs the extra `notebooks`; NAME is a part of a file name, without all are built)

The script is the source and the notebook its print: change the script and build again. A test compares the two.
"""

from __future__ import annotations

import base64
import io
import os
import sys
import time
from pathlib import Path

FOLDER = Path(__file__).parent
ROOT = FOLDER.parents[1]


def scripts(*names: str) -> list[Path]:
    """The scripts whose name holds one of the names, all of them without; in order."""
    return [path for path in sorted(FOLDER.glob("[0-9][0-9]_*.py")) if not names or any(name in path.name for name in names)]


def smaller(picture: str) -> str:
    """A picture of png, in base64, with the 256 colours that it needs at most: half its size."""
    from PIL import Image

    file = io.BytesIO()
    Image.open(io.BytesIO(base64.b64decode(picture))).convert("RGB").quantize(256, dither=Image.Dither.NONE).save(
        file, "png", optimize=True
    )
    return base64.b64encode(file.getvalue()).decode()


def build(path: Path) -> Path:
    """Run a script as a notebook and write it beside the script; raises the error of the cell that fails."""
    import jupytext
    import nbformat
    from nbclient import NotebookClient

    notebook = jupytext.read(path)
    NotebookClient(notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": str(ROOT)}}).execute()
    for i, cell in enumerate(notebook.cells):  # nothing that changes from one build to the next
        cell["id"], cell["metadata"] = f"cell-{i}", {}
        if cell.cell_type == "code":
            cell.outputs = [output for output in cell.outputs if output.get("name") != "stderr"]
            for data in (output["data"] for output in cell.outputs if "image/png" in output.get("data", {})):
                data["image/png"] = smaller(data["image/png"])
    notebook.metadata = nbformat.NotebookNode(
        jupytext={"formats": "ipynb,py:percent"},
        kernelspec={"display_name": "Python 3", "language": "python", "name": "python3"},
        language_info={"name": "python"},
    )
    target = path.with_suffix(".ipynb")
    nbformat.write(notebook, target)
    return target


def main() -> None:
    """Build the notebooks that the arguments name."""
    os.environ["PYTHONPATH"] = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    for path in scripts(*sys.argv[1:]):
        began = time.perf_counter()
        target = build(path)
        print(f"{target.name:44}{target.stat().st_size / 1e3:7.0f} kB{time.perf_counter() - began:7.1f} s", flush=True)


if __name__ == "__main__":
    main()
