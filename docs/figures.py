"""Figures of the studies as files of the site: pages show them as `figures/NAME.png`."""

from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

STUDIES = Path(__file__).parents[1] / "studies" / "figures"


def on_files(files: Any, config: Any) -> Any:
    """Add every figure of the studies."""
    for path in sorted(p for p in STUDIES.iterdir() if p.suffix in (".png", ".gif")):
        files.append(File.generated(config, f"figures/{path.name}", abs_src_path=str(path)))
    return files
