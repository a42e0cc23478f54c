"""The site: every public name has a page, and the built pages have their gallery, formulas, tables and a search that works from disk."""

from __future__ import annotations

import importlib
import inspect
import json
import os
import pkgutil
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import toolbox
from toolbox.faces import public_names

ROOT = Path(__file__).parents[2]
REFERENCE = ROOT / "docs" / "reference"
BROWSER = next((found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None)


def test_every_public_name_of_the_toolbox_and_its_rooms_stands_on_one_page_of_the_reference():
    pages = {
        path.stem: re.findall(r"^::: (toolbox(?:\.\w+)+)$", path.read_text(encoding="utf-8"), re.MULTILINE)
        for path in REFERENCE.glob("*.md")
    }
    named = [name for page, names in pages.items() if page != "authoring" for name in names]
    modules = [name for name in toolbox.__all__ if inspect.ismodule(getattr(toolbox, name)) and name != "authoring"]
    face = [name for name in (*toolbox.__all__, "time") if not inspect.ismodule(getattr(toolbox, name))]
    rooms = [room.name for room in pkgutil.iter_modules(toolbox.__path__) if room.ispkg and room.name != "authoring"]
    expected = [f"toolbox.{name}" for name in face]
    for place in (*modules, *rooms):
        module = importlib.import_module(f"toolbox.{place}")
        own = [name for name in public_names(module) if getattr(module, name) is not vars(toolbox).get(name)]
        expected += [f"toolbox.{place}.{name}" for name in own]
    assert sorted(name for name in named if name in expected) == sorted(expected)
    assert all(name in expected or name.rpartition(".")[0] in expected for name in named)  # the rest are methods of these
    assert sorted(pages["authoring"]) == [f"toolbox.authoring.{name}" for name in sorted(toolbox.authoring.__all__)]


def test_a_part_has_a_table_of_its_fields():
    page = "".join(path.read_text(encoding="utf-8") for path in sorted(REFERENCE.glob("*.md")))
    section = page.partition("::: models.BitRock\n")[2].partition("\n:::")[0]
    assert "| `weight` | 97347 | N | &gt;= 0 | 500 to 5e+06 | weight on bit |" in section
    assert page.count("| field | default | unit | bounds | usual | meaning |") > 30
    assert (
        "| weight on bit | Navarro-Lopez and Cortes (2007) |" in page and "| mass of the absorber |\n" in page
    )  # chosen numbers have no source


TYPED = """
    WOB, TOB, ROP, BHA, DLS, SSI, MSE, RPM, HWDP, MWD, drawworks, auto-driller, top drive, rotary table, dogleg, torque and drag, hook
    load, side force, friction factor, weight on bit, rate of penetration, bit bounce, whirl, HFTO, impedance matching, tripping, mud
    weight, drill collar, LAS, PDC, UCS, stuck pipe, judder, groan, squeal, creep groan, NVH, caliper, brake pad, disk brake, drum
    brake, clutch, Stribeck, mu-v, friction coefficient, mode coupling, complex eigenvalue, negative damping, chatter, hunting, dead
    time, latency, windup, anti-windup, set point, setpoint, phase margin, gain margin, delay margin, disk margin, Bode, Nyquist,
    transfer function, state space, sampling time, sample time, saturation, rate limit, feedforward, observer, Kalman, PID, MPC, LQG,
    gain scheduling, operating point, linearize, root locus, natural frequency, settling time, overshoot, limit cycle, identification,
    confidence interval, outlier, resume, checkpoint, Monte Carlo, parameter sweep, uncertainty, FMU, Simulink, Matlab, Excel,
    reinforcement learning, tutorial, license, changelog, citation, stick slip
"""
"""What a driller, a brake engineer and a student of control type into the search box."""


def sections_with(term, sections):
    """How many sections of the search index hold a term as a word, with a hyphen or a space, in the singular or the plural."""
    word = re.compile(r"(?<!\w)" + re.sub(r"(\\ |\\-)", "[- ]", re.escape(term.lower())) + r"(?:s|es)?(?!\w)")
    return sum(word.search(text) is not None for text in sections)


def test_a_term_is_found_as_a_word_and_not_inside_of_one():
    sections = ["the set-point of a drive", "two set points"]
    assert sections_with("set point", sections) == 2 and sections_with("set-point", sections) == 2
    assert sections_with("point", sections) == 2 and sections_with("poin", sections) == 0 and sections_with("ROP", ["propeller"]) == 0


def test_the_glossary_or_a_page_has_every_term_that_people_type():
    """The quick form of the test of the built search index: in the text of the pages."""
    texts = [path.read_text(encoding="utf-8").lower() for path in (ROOT / "docs").rglob("*.md")]
    assert [term for term in (" ".join(each.split()) for each in TYPED.split(",")) if not sections_with(term, texts)] == []


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    for needed in ("mkdocs", "material", "mkdocstrings", "latex2mathml"):
        pytest.importorskip(needed)
    folder = tmp_path_factory.mktemp("site")
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    words = [sys.executable, "-m", "mkdocs", "build", "--strict", "-q", "-d", str(folder)]
    done = subprocess.run(
        words, cwd=ROOT, env={**os.environ, "PATH": path, "NO_MKDOCS_2_WARNING": "1"}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.mark.slow
def test_the_gallery_shows_every_notebook_and_its_links_and_pictures_are_there(site):
    page = (site / "gallery.html").read_text(encoding="utf-8")
    cards = re.findall(r'<a class="card" href="([^"]+)"><img src="([^"]+)"', page)
    notebooks = sorted((ROOT / "studies" / "notebooks").glob("[0-9][0-9]_*.ipynb"))
    assert [link for link, _ in cards if link.startswith("notebooks/")] == [f"notebooks/{path.stem}.html" for path in notebooks]
    assert len(cards) > len(notebooks) + 15
    for link, picture in cards:
        assert (site / link).is_file() and (site / picture).stat().st_size > 1000


@pytest.mark.slow
def test_formulas_are_mathml_and_nothing_comes_from_elsewhere(site):
    for name in ("concepts/contacts", "notebooks/02_block_on_a_belt"):
        page = (site / f"{name}.html").read_text(encoding="utf-8")
        assert page.count("<math") > 3 and "arithmatex" not in page
    for path in site.rglob("*.html"):
        assert not re.findall(r'<(?:script|img|link)[^>]+(?:src|href)="https?://', path.read_text(encoding="utf-8")), path.name


@pytest.mark.slow
def test_the_search_index_has_a_hit_for_every_term_that_people_type(site):
    index = json.loads((site / "search" / "search_index.json").read_text(encoding="utf-8"))
    sections = [re.sub("<[^>]+>", " ", f"{each['title']} {each['text']}").lower() for each in index["docs"]]
    assert len(sections) > 300 and not sections_with("zxqv", sections)
    assert [term for term in (" ".join(each.split()) for each in TYPED.split(",")) if not sections_with(term, sections)] == []


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="there is no Chromium")
def test_the_search_finds_a_verb_in_a_browser_that_reads_from_disk(site, tmp_path):
    words = [
        BROWSER,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        f"--user-data-dir={tmp_path}",
        "--virtual-time-budget=20000",
        "--dump-dom",
    ]
    done = subprocess.run([*words, f"file://{site}/index.html?q=hopf_points"], capture_output=True, text=True, timeout=300, check=False)
    found = re.findall(r'href="[^"]*?([\w/]+\.html)[^"]*" class="md-search-result__link"', done.stdout)
    assert any(place.endswith("reference/steady_states.html") for place in found), done.stdout[-2000:]
