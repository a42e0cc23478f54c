"""A report: every number in it is that of the arrays it came from, and the page needs nothing else."""

import base64
import csv
import html.parser
import json
import math
import os
import re
import shutil
import time

import numpy as np
import pytest

from controllers import PI, Lifting, SoftTorque
from models import BitRock, Coulomb, TorsionalChain, wells
from tests.plants import RIG
from toolbox import Sampled, closed_loop, compose, simulate
from toolbox.commands.command_line import main
from toolbox.errors import SceneError
from toolbox.files.origin import Origin
from toolbox.onsets.results import Onset
from toolbox.reports import report, to_pdf
from toolbox.reports.machine import sketch
from toolbox.reports.page import page as whole_page
from toolbox.reports.sections import Section

SCENE = """
title = "Two inertias <95 rpm>"
duration = "40 s"
reference = "95 rpm"
[[plant]]
part = "wells.JANSEN_2"
[[plant]]
part = "BitRock"
[[controllers]]
label = "stiff PI"
law = "StiffPI"
[[controllers]]
label = "soft torque"
law = "SoftTorque"
"""


class Page(html.parser.HTMLParser):
    """The rows of all tables of a page, the lines of its preformatted texts, its paragraphs, points of lists and captions, and all that a browser fetches."""

    def __init__(self, text):
        super().__init__()
        self.tables, self.lines, self.told, self.fetched, self.inside = [], [], [], [], ""
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        assert tag not in ("script", "link", "iframe", "object")
        self.fetched += [value for name, value in attributes if name in ("src", "href", "srcset")]
        self.inside = tag if tag in ("td", "th", "pre", "p", "li", "figcaption", "text") else self.inside if tag in ("b", "code") else ""
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th"):
            self.tables[-1][-1].append("")
        elif self.inside == tag:
            (self.lines if tag == "pre" else self.told).append("")

    def handle_data(self, data):
        if self.inside in ("td", "th"):
            self.tables[-1][-1][-1] += data
        elif self.inside:
            (self.lines if self.inside == "pre" else self.told)[-1] += data

    def handle_endtag(self, tag):
        if tag not in ("b", "code"):
            self.inside = ""

    def found(self, first):
        return next(rows for rows in self.tables if rows[0][0] == first)


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    folder = tmp_path_factory.mktemp("results")
    (folder / "rig.toml").write_text(SCENE)
    assert main(["study", str(folder / "rig.toml"), "--out", str(folder / "study")]) == 0
    asked = ["--range", "top.reference=80 rpm:150 rpm", "--values", "3", "--controller", "stiff PI"]
    assert main(["onset", str(folder / "rig.toml"), *asked, "--out", str(folder / "onset")]) == 0
    return folder


@pytest.fixture(scope="module")
def page(folders):
    return report(folders / "study", folders / "onset", path=folders / "report.html").read_text()


def test_the_verdict_table_is_that_of_the_study(folders, page):
    head, *rows = next(rows for rows in Page(page).tables if "stuck" in rows[0])
    with (folders / "study" / "table.csv").open(newline="") as file:
        told = list(csv.DictReader(file))
    assert [row[0] for row in rows] == [row["controller"] for row in told] and len(rows) == 2
    for row, own in zip(rows, told, strict=True):
        cell = dict(zip(head, row, strict=True))
        assert cell["verdict"] == own["verdict"]
        assert float(cell["stuck"].removesuffix(" s")) == pytest.approx(float(own["stuck"]), abs=0.005)
        assert float(cell["severity"]) == pytest.approx(float(own["severity"]), abs=5e-4)
        value, unit = cell["peak top.torque"].split(" ", 1)
        assert unit == "kN m" and 1e3 * float(value) == pytest.approx(float(own["peak"]), rel=1e-3)
        assert (cell["settling"] == "never") == (own["settling"] == "inf")


def test_the_borders_are_those_of_the_onset(folders, page):
    onset = Onset.load(next((folders / "onset").glob("*.npz")))
    assert "Hopf point" in page and onset.ends
    assert f"{onset.end * 30 / math.pi:.6g} rpm" in page  # as printed
    assert onset.title in page


def test_the_machine_and_the_gains_stand_in_it(page):
    numbers = {row[0]: row[1:3] for row in Page(page).found("number")[1:]}
    assert numbers["chain.inertia"] == ["2122, 374", "kg m2"] and numbers["bit.weight"] == ["97.347", "kN"]
    laws = {row[0]: row[1] for rows in Page(page).tables for row in rows if rows[0] == ["controller", "its numbers"]}
    assert "proportional 0.4206 kN m s/rad" in laws["soft torque"]
    assert page.count("kg m&#178;") == 2  # the sketch


def test_laws_that_took_other_gains_on_another_machine_say_whose_they_are():
    def section(kind, string):
        return Section("My rig", kind, "", loops=(("soft torque", closed_loop(compose(string, BitRock()), SoftTorque())),))

    study, again = section("Study", wells.JANSEN_2), section("Onset", wells.JANSEN_2)
    text = whole_page("My rig", [study, again, section("Gains over depth", wells.NAVARRO_LOPEZ_2)])
    assert re.findall("<h2>Laws of: (.*?)</h2>", text) == ["Study, Onset", "Gains over depth"]
    assert "Laws of:" not in whole_page("My rig", [study, again])  # the same gains stand once


BRAKE = """
title = "A stop"
duration = "1 s"
[verdict]
effort = "brake.force"
standstill_speed = "0.1 rad/s"
signal = "disc.speed"
[[plant]]
part = "DiscBrake"
[start]
"disc.speed" = "2 rad/s"
[inputs]
"pad.attachment" = { sine = { mean = 0.0, amplitude = "4 N", frequency = "40 Hz" } }
[[controllers]]
label = "planned"
law = "BrakeMPC"
sample_time = "30 ms"
[[controllers]]
label = "force"
law = "BrakeForce"
deceleration = "2.5 rad/s2"
force_rate = "20 kN/s"
sample_time = "1 ms"
"""


def test_a_brake_reads_in_the_units_that_were_typed_and_a_law_in_python_and_a_shape_tell_their_numbers(tmp_path):
    path = tmp_path / "stop.toml"
    path.write_text(BRAKE)
    assert main(["study", str(path), "--out", str(tmp_path / "out")]) == 0
    text = re.sub("<[^>]+>", " ", report(tmp_path / "out", path=tmp_path / "page.html").read_text())
    assert "to standstill at 0.1 rad/s" in text and "deceleration 2.5 rad/s2" in text and "force_rate 20 kN/s" in text
    assert "rpm" not in text
    assert re.search(r"BrakeMPC, sampled every 30 ms: .*speed_scale 0.2 rad/s", text)
    assert text.count("inputs: pad.attachment sine (mean 0 N, amplitude 4 N, frequency 40 Hz, phase 0 rad)") == 1  # shared by both
    assert re.search(r"all of them\s+inputs:", text)


def test_the_law_inside_of_another_and_its_observer_are_named():
    words = closed_loop(compose(wells.JANSEN_2, BitRock()), Sampled(Lifting(SoftTorque(reference="95 rpm")), 0.01)).controller_names[0]
    assert re.match(r"Lifting, sampled every 10 ms: law PI \(.*proportional .*\), .*observer Kalman \(speed_noise ", words)


@pytest.mark.parametrize("count", [2, 3, 9])
def test_a_sketch_spaces_the_inertias_evenly_along_the_shaft_and_draws_each_as_wide_as_it_is_heavy(count):
    heavy = np.linspace(900.0, 100.0, count)
    chain = TorsionalChain(
        inertia=tuple(heavy),
        stiffness=(1e3,) * (count - 1),
        damping=(10.0,) * (count - 1),
        friction=Coulomb(static=1.0, kinetic=0.8),
        friction_load=(1e3,) * count,
    )
    drawn = sketch(closed_loop(compose(chain)))
    x, y, width, height = np.array(re.findall(r'<rect x="(.*?)" y="(.*?)" width="(.*?)" height="(.*?)"', drawn), float).T
    top, bottom = (float(each) for each in re.search(r'<line x1="60" y1="(.*?)" x2="60" y2="(.*?)"', drawn).groups())
    np.testing.assert_allclose(y + height / 2, np.linspace(top, bottom, count), atol=0.15)  # rounded to tenths of a point
    np.testing.assert_allclose(x + width / 2, 60.0, atol=0.15)
    np.testing.assert_allclose((width / 2 - 6.0) ** 2 / (width[0] / 2 - 6.0) ** 2, heavy / heavy[0], atol=0.01)
    assert (np.diff(y) > height[:-1]).all()  # none covers the next


def test_the_page_needs_nothing_else(page):
    fetched = Page(page).fetched
    assert len(fetched) >= 6 and all(each.startswith("data:image/png;base64,") for each in fetched)
    assert "default-src 'none'" in page and "url(" not in page and "@import" not in page
    assert "<95 rpm>" not in page and "&lt;95 rpm&gt;" in page
    assert len(page) < 2e6


@pytest.mark.slow
def test_the_report_of_the_main_study_is_small_and_soon_there(root, tmp_path):
    """At most 2 MB, and 10 s of the processor beyond the study."""
    assert main(["study", str(root / "studies" / "scenes" / "navarro_lopez_4.toml"), "--quiet", "--out", str(tmp_path / "study")]) == 0
    began = time.process_time()
    page = report(tmp_path / "study", path=tmp_path / "study.html")
    assert time.process_time() - began < 10.0 and page.stat().st_size < 2e6


def test_it_says_how_to_get_the_same_again(folders, page):
    assert f"stickslip study {folders / 'rig.toml'} --out {folders / 'study'}" in page
    assert "casadi " in page and "SHA-256" in page
    assert report(folders / "study", folders / "onset", path=folders / "again.html").read_text() == page


def test_a_file_that_was_changed_since_is_named(folders, tmp_path):
    shutil.copytree(folders / "study", tmp_path / "study")
    (tmp_path / "study" / "comparison.png").write_bytes(b"other")
    assert "or gone: comparison.png" in report(tmp_path / "study", path=tmp_path / "r.html").read_text()


def test_results_of_python_have_their_answer_figure_and_machine(tmp_path):
    run = simulate(closed_loop(RIG, PI(proportional=4000.0, integral=1500.0, reference=9.0), label="PI & I"), "10 s")
    text = report(run, path=tmp_path / "run.html", title="Mine").read_text()
    assert "<h1>Mine</h1>" in text and text.count("data:image/png") == 1
    assert "chain.inertia" in text and "PI &amp; I" in text
    assert f"{len(run.events)} events" in text


def test_a_folder_of_folders_stands_for_all_in_it(folders, tmp_path):
    for name in ("one", "map/two"):  # a map has a folder for each controller
        shutil.copytree(folders / "study", tmp_path / "all" / name)
    assert report(tmp_path / "all", path=tmp_path / "r.html").read_text().count("<h2>Study</h2>") == 2


@pytest.mark.parametrize(
    ("given", "path", "words"),
    [
        ((), "r.html", "there are none"),
        (("none",), "r.html", "there is no folder `none`"),
        ((".",), "r.txt", "must end with .html"),
        ((5,), "r.html", "one is 5"),
    ],
)
def test_what_is_no_result_is_refused(tmp_path, monkeypatch, given, path, words):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SceneError, match=re.escape(words)):
        report(*given, path=path)
    assert not (tmp_path / path).exists()


def test_a_folder_of_something_else_and_a_damaged_one_are_refused(folders, tmp_path, capsys):
    (tmp_path / "mine").mkdir()
    page = str(tmp_path / "r.html")
    assert main(["report", str(tmp_path / "mine"), "--page", page]) == 2
    assert "is none" in capsys.readouterr().err
    shutil.copytree(folders / "study", tmp_path / "study")
    (tmp_path / "study" / "table.csv").write_text("controller,verdict\none,free\n")
    assert main(["report", str(tmp_path / "study"), "--page", page]) == 2
    assert "the table of a study" in capsys.readouterr().err


def test_the_command_writes_the_page_and_hides_no_file_of_the_user(folders, tmp_path, capsys):
    page = tmp_path / "r.html"
    for _ in range(2):  # an earlier report is replaced
        assert main(["report", str(folders / "study"), "--page", str(page)]) == 0
    assert "1 folder is in" in capsys.readouterr().out
    page.write_text("<html>mine</html>")
    assert main(["report", str(folders / "study"), "--page", str(page)]) == 2
    assert page.read_text() == "<html>mine</html>"


def test_without_a_program_that_prints_a_pdf_the_page_is_written_and_the_missing_pdf_is_told(folders, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(to_pdf, "BROWSERS", ())
    monkeypatch.setitem(__import__("sys").modules, "weasyprint", None)
    with pytest.raises(SceneError, match=r"The page is in `.*r\.html`, but its PDF was not written\. A PDF needs Chromium"):
        report(folders / "study", path=tmp_path / "r.html", pdf=True)
    assert "Two inertias" in (tmp_path / "r.html").read_text() and not (tmp_path / "r.pdf").exists()
    assert main(["report", str(folders / "study"), "--page", str(tmp_path / "r.html"), "--pdf"]) == 2
    assert "its PDF was not written" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.skipif(not any(map(shutil.which, to_pdf.BROWSERS)), reason="no browser that prints is installed")
def test_a_browser_prints_the_page(folders, tmp_path):
    report(folders / "study", path=tmp_path / "r.html", pdf=True)
    assert (tmp_path / "r.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.skipif(os.name != "posix", reason="symbolic links of POSIX")
def test_a_report_shows_no_file_outside_of_its_folders(folders, tmp_path):
    secret = '<svg xmlns="http://www.w3.org/2000/svg"><text>secret of mine</text></svg>'
    (tmp_path / "secret.svg").write_text(secret)
    (tmp_path / "secret.txt").write_text("secret of mine")
    coded = base64.b64encode(secret.encode()).decode()
    copy = shutil.copytree(folders / "study", tmp_path / "study")

    def page():
        return report(copy, path=tmp_path / "report.html").read_text()

    (copy / "own.svg").write_text(secret)
    assert coded in page()  # the same figure without a link is shown
    (copy / "own.svg").unlink()
    (copy / "01_evil.svg").symlink_to(tmp_path / "secret.svg")
    assert coded not in page() and "Left out, because they are symbolic links: 01_evil.svg." in page()
    for name in ("study.txt", "scene.toml", "table.csv", "origin.json"):
        (copy / name).rename(copy / "kept")
        (copy / name).symlink_to(tmp_path / "secret.txt")
        with pytest.raises(SceneError, match=f"must hold no symbolic links, but `.*{name}` is one"):
            page()
        (copy / name).unlink()
        (copy / "kept").rename(copy / name)
    (tmp_path / "above").mkdir()
    (tmp_path / "above" / "inner").symlink_to(copy)
    with pytest.raises(SceneError, match="but `.*above` is none"):
        report(tmp_path / "above", path=tmp_path / "report.html")
    (tmp_path / "given").symlink_to(copy)
    assert "Two inertias" in report(tmp_path / "given", path=tmp_path / "report.html").read_text()


def test_an_origin_that_names_files_elsewhere_opens_none(folders, tmp_path, monkeypatch):
    copy = shutil.copytree(folders / "study", tmp_path / "study")
    (tmp_path / "secret.txt").write_text("mine")
    told = json.loads((copy / "origin.json").read_text())
    told["files"] = {"../secret.txt": "0", str(tmp_path / "secret.txt"): "0"}
    (copy / "origin.json").write_text(json.dumps(told))
    monkeypatch.setattr("toolbox.files.origin.hashes", lambda paths: pytest.fail(f"opened {paths}"))
    assert Origin.read(copy).changed(copy) == list(told["files"])
