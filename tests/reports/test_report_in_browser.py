"""A report that is opened from disk, in a browser: it asks for nothing, and goes onto a phone."""

import shutil

import pytest

from controllers import SoftTorque
from models import BitRock, wells
from toolbox import closed_loop, compose, onset
from toolbox.reports import report

playwright = pytest.importorskip(
    "playwright.sync_api", reason="reports are tried in a browser by playwright, pip install 'stickslip-toolbox[browser]'"
)
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on the path")
def test_a_report_from_disk_makes_no_request_and_says_nothing_on_the_console(tmp_path):
    found = onset(
        closed_loop(compose(wells.JANSEN_2, BitRock()), SoftTorque()), "top.reference", (6.0, 10.0), duration="60 s", num_values=3
    )
    path = report(found, path=tmp_path / "report.html")
    asked, said = [], []
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        tab = browser.new_page(viewport={"width": 390, "height": 844})
        tab.on("request", lambda request: asked.append(request.url))
        tab.on("console", lambda message: said.append(message.text))
        tab.on("pageerror", lambda error: said.append(str(error)))
        tab.goto(path.as_uri())
        assert tab.evaluate(
            "[...document.images].length > 0 && [...document.images].every((each) => each.complete && each.naturalWidth > 0)"
        )
        assert tab.evaluate("document.documentElement.scrollWidth <= innerWidth")
        browser.close()
    assert said == [] and [url for url in asked if not url.startswith("data:")] == [path.as_uri()]
