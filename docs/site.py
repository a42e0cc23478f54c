"""What the site has beside the pages of this folder: figures of the studies, notebooks, the gallery, and formulas as MathML.

mkdocs calls these functions while it builds (`hooks` in mkdocs.yml); nothing is written into the folder.
"""

from __future__ import annotations

import base64
import importlib.util
import json
import re
from html import escape, unescape
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File

ROOT = Path(__file__).parents[1]
FIGURES = ROOT / "studies" / "figures"
NOTEBOOKS = sorted((ROOT / "studies" / "notebooks").glob("[0-9][0-9]_*.ipynb"))
FORMULA = re.compile(r'<(span|div) class="arithmatex">(.*?)</\1>', re.DOTALL)
SHOWN = {
    "bit_rock": "bit_rock_laws.png", "brakes": "brakes.png", "chatter": "chatter.png", "cycles": "cycles.png", "detail": "detail.png",
    "disk_stack": "disk_stack.png", "disks": "two_disks.png", "dither": "dither.png", "drives": "drives.png", "elastic_pad": "elastic_pad.png",
    "elastic_sliders": "elastic_slider.gif", "maps": "map_string.png", "networks": "networks.png", "onset": "onset.png",
    "oscillators": "oscillators_belt.png", "pictures": "stick_slip.png", "robustness": "robustness.png", "sliders": "slider_adhesion.png",
    "torus": "torus.png", "tune_drive": "tune_drive.png", "views": "stability_chart.png", "whirl": "whirl.png", "tradeoff": "work_precision.png",
}  # fmt: skip
"""{study: its figure in the gallery}."""


def on_config(config: Any) -> Any:
    """Put the notebooks, which are not files of this folder, into the navigation."""
    tutorials = next(entry["Tutorials"] for entry in config["nav"] if "Tutorials" in entry)
    place = next(entry for entry in tutorials if "Notebooks" in entry)
    place["Notebooks"] = [{_title(path): f"notebooks/{path.stem}.md"} for path in NOTEBOOKS]
    return config


def on_files(files: Any, config: Any) -> Any:
    """Add figures, notebooks with their pictures, and the gallery."""
    for path in sorted(p for p in FIGURES.iterdir() if p.suffix in (".png", ".gif")):
        files.append(File.generated(config, f"figures/{path.name}", abs_src_path=str(path)))
    for path in NOTEBOOKS:
        text, pictures = notebook_page(path)
        files.append(File.generated(config, f"notebooks/{path.stem}.md", content=text))
        for name, content in pictures.items():
            files.append(File.generated(config, f"notebooks/{name}", content=content))
    files.append(File.generated(config, "gallery.md", content=gallery_page()))
    files.append(File.generated(config, "changelog.md", content=(ROOT / "CHANGELOG.md").read_text(encoding="utf-8")))
    files.append(File.generated(config, "licence.md", content=licence_page()))
    return files


def on_page_content(html: str, **_: Any) -> str:
    """Write formulas, which stand in the pages as LaTeX, as MathML: browsers draw it by themselves, also from disk."""
    return FORMULA.sub(_mathml, html)


def _mathml(found: re.Match[str]) -> str:
    text = unescape(found[2]).strip()
    block = text.startswith("\\[")
    return convert(text[2:-2].strip(), display="block" if block else "inline")


def notebook_page(path: Path) -> tuple[str, dict[str, bytes]]:
    """A notebook as a page: its text, its code, what it printed and its pictures, {file name: content}."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    lines, pictures = [], {}
    for cell in cells:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            lines += [source, ""]
            continue
        lines += ["```python", source, "```", ""]
        for output in cell["outputs"]:
            data = output.get("data", {})
            if "image/png" in data:
                name = f"{path.stem}_{len(pictures) + 1}.png"
                pictures[name] = base64.b64decode("".join(data["image/png"]))
                lines += [f"![Figure {len(pictures)} of the notebook]({name})", ""]
            elif output["output_type"] == "stream" or "text/plain" in data:
                lines += ["```text", "".join(output.get("text") or data["text/plain"]).rstrip(), "```", ""]
    lines += ["", f"*This page is the notebook `studies/notebooks/{path.name}`; run it, or the script of the same name beside it.*", ""]
    return "\n".join(lines), pictures


def gallery_page() -> str:
    """Thumbnails of notebooks and studies with the question that each asks."""
    spec = importlib.util.spec_from_file_location("studies_list", ROOT / "studies" / "__main__.py")
    assert spec is not None and spec.loader is not None
    listing = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(listing)
    lines = [
        "# Gallery",
        "",
        "Every picture is made by a notebook or a study that you can run; each answers a question with numbers that tests hold.",
    ]
    lines += ["", "## Notebooks", ""]
    cards = []
    for path in NOTEBOOKS:
        pictures = notebook_page(path)[1]
        first = next(iter(pictures), None)
        cards.append(_card(_title(path), _question(path), f"notebooks/{first}" if first else None, f"notebooks/{path.stem}.html"))
    lines += ['<div class="gallery">', *cards, "</div>", "", "## Studies", "", '<div class="gallery">']
    for room in listing.ROOMS:
        for name, question in listing.studies(room).items():
            if name in SHOWN:
                lines.append(_card(f"python -m studies {name}", escape(question), f"figures/{SHOWN[name]}", f"figures/{SHOWN[name]}"))
    return "\n".join([*lines, "</div>", ""])


def licence_page() -> str:
    """The licence, and how to cite the toolbox."""
    licence, citation = ((ROOT / name).read_text(encoding="utf-8") for name in ("LICENSE", "CITATION.cff"))
    lines = [
        "# Licence and citation",
        "",
        "The toolbox is free software under the BSD 3-Clause licence (license).",
        "",
        "```text",
        licence.rstrip(),
        "```",
    ]
    return "\n".join([*lines, "", "## How to cite", "", "`CITATION.cff`:", "", "```yaml", citation.rstrip(), "```", ""])


def _card(title: str, text: str, picture: str | None, link: str) -> str:
    words = re.sub("<[^>]*>", "", text)  # what the picture answers; formulas as their symbols
    image = f'<img src="{picture}" alt="{words}" loading="lazy">' if picture else ""
    return f'<a class="card" href="{link}">{image}<strong>{escape(title)}</strong><span>{text}</span></a>'


def _markdown(path: Path) -> str:
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    return "".join(cells[0]["source"])


def _title(path: Path) -> str:
    return _markdown(path).partition("\n")[0].lstrip("# ").strip()


def _question(path: Path) -> str:
    """The question that a notebook asks in its first cell, as HTML."""
    found = re.search(r"\*\*Question\.\*\*\s*(.+?)(?=\n\n|\Z)", _markdown(path), re.DOTALL)
    parts = re.split(r"\$([^$]+)\$", " ".join((found[1] if found else "").split()))
    return "".join(convert(part) if i % 2 else escape(re.sub(r"[*`]", "", part)) for i, part in enumerate(parts))
