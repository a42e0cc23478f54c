"""The page in a browser: what somebody who turns, types, drags and clicks gets to see."""

import argparse
import json
import random
import shutil
import time
from pathlib import Path

import pytest

from toolbox import Scene
from toolbox.commands.terminal import otherwise
from toolbox.onsets.verdicts import verdict_of
from toolbox.page import explore

playwright = pytest.importorskip(
    "playwright.sync_api", reason="pages are tried in a browser by playwright, pip install 'stickslip-toolbox[browser]'"
)
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason="no chromium on the path")]

SCENES = Path(__file__).parents[2] / "studies" / "scenes"
PHONE = {"viewport": {"width": 390, "height": 844}, "is_mobile": True, "has_touch": True}


class Tab:
    """One tab of the browser, what it was told to say on its console, and what it asked for."""

    def __init__(self, browser, address, **kind):
        self.context = browser.new_context(**{"viewport": {"width": 1300, "height": 900}, **kind})
        self.page, self.said, self.requests = self.context.new_page(), [], []
        self.page.on("console", lambda message: self.said.append(message.text))
        self.page.on("pageerror", lambda error: self.said.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(address)
        self.settle()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.context.close()

    def __call__(self, script):
        """The value of an expression in the page; the page itself may evaluate no text."""
        return self.page.evaluate(script)

    def until(self, condition, seconds=60.0):
        end = time.monotonic() + seconds
        while not self(condition):
            assert time.monotonic() < end, f"{condition}: {self('document.body.dataset')}, {self.said}"
            time.sleep(0.02)

    def settle(self):
        """Wait until all that was turned is answered and painted."""
        self.until("asked > 0 && answered === asked && !running && document.body.dataset.painted === String(asked)")

    def followed(self):
        """Wait for what follows the run: error, poles, numbers without effect."""
        self.settle()
        self.until("document.body.dataset.followed === String(asked)")

    def type(self, name, text):
        box = self.page.locator(f"#n-{name.replace('.', '-').replace('_', '-')}")
        box.fill(text)
        box.press("Enter")
        box.blur()
        self.settle()

    @property
    def print(self):
        return self("document.body.dataset.print")

    @property
    def setting(self):
        return self("copied(setting)")


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as driver:
        started = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield started
        started.close()


@pytest.fixture
def tab(browser, page):
    with Tab(browser, page.address) as opened:
        yield opened
        assert opened.said == []
        assert all(url.startswith((page.address, "data:", "blob:")) for url in opened.requests)


def test_every_control_has_a_name_for_keyboards_and_screen_readers(tab):
    tab.page.select_option("#law", "soft torque")
    tab.page.fill("#search", "friction")
    tab.followed()
    controls = tab.page.locator("button:visible, input:visible, select:visible, canvas:visible, [tabindex]:visible, [role=img]:visible")
    names = []
    for k in range(controls.count()):
        names += controls.nth(k).aria_snapshot().splitlines()[:1]
    assert len(names) > 30 and [name for name in names if '"' not in name] == []
    for _ in range(4):  # the first that the keyboard reaches
        tab.page.keyboard.press("Tab")
        assert tab("document.activeElement.matches('button, input, select, canvas')")


def test_every_number_changes_the_run_or_says_why_it_does_not(tab):
    tab.page.select_option("#law", "softer PI, 100 Hz")
    tab.followed()
    rest = tab.print
    for each in tab("law().controls"):
        if tab.page.locator(f"#n-{each['name'].replace('.', '-').replace('_', '-')}").count() == 0:
            tab.page.fill("#search", each["name"])
        now = tab(f"valueOf({json.dumps(each['name'])})") * each["factor"]
        tab.type(each["name"], repr(each["low"] + 0.37 * (each["high"] - each["low"]) if now == 0 else 0.93 * now))
        why = tab.page.locator(f"#n-{each['name'].replace('.', '-').replace('_', '-')}-why").inner_text()
        refused = tab.page.locator("#said.wrong").count()
        assert (tab.print != rest) != bool(why or refused), (each["name"], why)
        tab.page.click("#undo")
        tab.settle()
        assert tab.print == rest, each["name"]


def test_a_fast_drag_ends_on_its_last_value(tab, page):
    slider = tab.page.get_by_role("slider", name="bit.weight").first
    box = slider.bounding_box()
    tab.page.mouse.move(box["x"] + 0.4 * box["width"], box["y"] + box["height"] / 2)
    tab.page.mouse.down()
    for k in range(120):
        tab.page.mouse.move(box["x"] + box["width"] * (0.5 + 0.3 * random.Random(k).uniform(-1, 1)), box["y"] + box["height"] / 2)
    tab.page.mouse.move(box["x"] + 0.7 * box["width"], box["y"] + box["height"] / 2)
    tab.page.mouse.up()
    tab.settle()
    shown, setting = float(slider.input_value()), tab.setting
    assert setting["changes"] == {"bit.weight": pytest.approx(1e3 * shown)} and 150 < shown < 190
    assert page._answer("run", {"setting": setting})["print"] == tab.print
    tab.page.click("#undo")  # the whole drag is one step
    tab.settle()
    assert tab.setting["changes"] == {}


def test_a_click_on_the_map_sets_both_numbers_and_arrow_keys_move_on(tab):
    tab.page.select_option("#law", "stiff PI")
    tab.settle()
    tab.until("map !== null && Boolean(map.axes)")
    canvas, size = tab.page.locator("#map"), tab.page.locator("#map").bounding_box()
    canvas.click(position={"x": 58 + 0.7 * (size["width"] - 68), "y": 8 + 0.75 * (size["height"] - 42)})
    tab.settle()
    across, up = tab("chosenAxes()")
    (left, right), (low, high) = tab("mapRanges()")
    changes = tab.setting["changes"]
    read = {name: changes[name] * tab(f"control({json.dumps(name)}).factor") for name in (across, up)}
    assert read[across] == pytest.approx(left + 0.7 * (right - left), abs=0.01 * (right - left))
    assert read[up] == pytest.approx(low + 0.25 * (high - low), abs=0.01 * (high - low))
    assert "free" in tab.page.inner_text("#word") and "Raise" not in tab.page.inner_text("#where")
    canvas.focus()
    for _ in range(24):
        tab.page.keyboard.press("ArrowLeft")
    tab.settle()
    assert tab.setting["changes"][across] < changes[across] and tab.setting["changes"][up] == pytest.approx(changes[up], rel=1e-3)
    assert tab.page.inner_text("#word") == "stick-slip" and tab.page.inner_text("#where").startswith(f"Raise {across} above ")


def test_a_driller_finds_how_fast_to_turn_at_his_weight_and_what_the_drive_needs(tab, scene):
    tab.page.select_option("#law", "soft torque")
    tab.settle()
    tab.type("bit.weight", "80")
    tab.followed()
    tab.until("map !== null && Boolean(map.last)")
    words = tab.page.inner_text("#where").replace("about ", "")
    assert words.startswith("Here stick-slip dies out: it lasts below top.reference ") and " rpm" in words
    heaviest = float(words.split(" At this top.reference it lasts above bit.weight ")[1].split(" kN")[0])
    assert 80.0 < heaviest == pytest.approx(tab("met('sticking', [valueOf('top.reference') * 30 / Math.PI, 80], 1)[0]"), rel=0.01)
    tab.page.click("#drive summary")
    loop = scene["soft torque"].at("bit.weight", 80e3)
    assert tab.page.locator("#drive-words li").all_inner_texts() == loop.controller_names
    assert "proportional 0.4206 kN m s/rad" in loop.controller_names[0]


def test_a_brake_engineer_finds_the_way_of_a_stop_and_from_which_force_on_the_pad_groans(browser):
    with explore(Scene.load(SCENES / "brake_laws.toml"), port=0) as served, Tab(browser, served.address) as tab:
        assert "stopping distance\n" in tab.page.inner_text("#measures") and "stands at\n" in tab.page.inner_text("#measures")
        assert tab.page.inner_text("#spectrum-name").startswith("of pad slip from ") and "HeldSpeed" in tab.page.inner_text("#map-words")
        assert tab.said == []
    stop = Scene.load(SCENES / "brake_stop.toml")
    bench = otherwise(stop, argparse.Namespace(law="HeldSpeed", hold=()))
    with explore(bench, "10 s", port=0) as served, Tab(browser, served.address) as tab:
        tab.page.select_option("#axis-x", "brake.force")
        tab.until("map !== null && Boolean(map.last)", 120.0)
        words = tab.page.inner_text("#where").replace("about ", "")
        assert words.startswith("Lower brake.force below ") and " N and stick-slip ends" in words
        border = float(words.removeprefix("Lower brake.force below ").split()[0])
        for part, groans in ((0.85, False), (1.3, True)):
            tab.type("brake.force", repr(part * border))
            assert (tab.page.inner_text("#word") == "stick-slip") == groans, (part, border)
        assert tab.said == []


def test_a_student_finds_the_natural_frequency_and_why_it_sticks_at_one_speed_and_not_at_another(tab, scene):
    tab.page.select_option("#law", "soft torque")
    tab.type("top.reference", "30 rpm")
    tab.followed()
    assert tab.page.inner_text("#word") == "stick-slip" and "A small disturbance of smooth running grows" in tab.page.inner_text("#reason")
    assert f"; loudest at {tab('short(live.spectrum.tone)')} Hz" in tab.page.inner_text("#spectrum-name")
    assert " Hz (" in tab.page.inner_text("#poles-words") and "is unstable" in tab.page.inner_text("#poles-words")
    assert "bit.speed\n0 to " in tab.page.inner_text("#measures")
    tab.page.click("#pin")
    tab.type("top.reference", "100 rpm")
    tab.followed()
    assert tab.page.inner_text("#word") == "free" and "A small disturbance of smooth running dies" in tab.page.inner_text("#reason")
    assert "stick-slip" in tab.page.inner_text("#pinned") and "is stable" in tab.page.inner_text("#poles-words")
    drawn = tab.page.get_attribute("#poles", "aria-label")
    assert drawn.count(" i") == sum(abs(pole[1]) > 0 for pole in tab("live.poles"))  # none that swings is left out


def test_the_advice_at_a_border_names_the_side_on_which_stick_slip_ends(tab):
    """Under a constant torque the map goes over the weight, of which stick-slip wants more."""
    tab.until("map !== null && map.points >= 9")
    assert tab("chosenAxes()[0]") == "bit.weight" and tab.page.inner_text("#word") == "stick-slip"
    words = tab.page.inner_text("#where").replace("about ", "")
    assert words.startswith("Lower bit.weight below ") and "points" not in words
    tab.type("bit.weight", repr(0.9 * float(words.removeprefix("Lower bit.weight below ").split()[0])))
    assert tab.page.inner_text("#word").startswith("free") or tab.page.inner_text("#word") == "recovered after 1 stick"
    assert tab.page.inner_text("#where").startswith("Here stick-slip dies out: it lasts above bit.weight")


def test_two_tabs_keep_apart(browser, page, tab):
    with Tab(browser, page.address) as other:
        tab.page.select_option("#law", "stiff PI")
        tab.settle()
        other.page.select_option("#law", "soft torque")
        other.settle()
        tab.type("bit.weight", "80")
        other.type("bit.weight", "50")
        assert tab.setting == {"label": "stiff PI", "changes": {"bit.weight": 80e3}, "disturbance": ""}
        assert other.setting == {"label": "soft torque", "changes": {"bit.weight": 50e3}, "disturbance": ""}
        assert page._answer("run", {"setting": tab.setting})["print"] == tab.print != other.print
        assert other.said == []


def test_a_page_from_elsewhere_in_the_same_browser_gets_nothing(browser, page):
    """A page with another origin cannot read, ask or frame it; an address without the token is refused."""
    port = page.server.server_address[1]
    context = browser.new_context()
    foreign = context.new_page()
    foreign.route("http://evil.example/", lambda route: route.fulfill(body="<p>elsewhere</p>", content_type="text/html"))
    foreign.goto("http://evil.example/")
    ask = "async (address) => { try { const r = await fetch(address, {method: 'POST', body: '{}'}); return r.status; } catch (failure) { return 'refused'; } }"
    assert foreign.evaluate(ask, f"{page.address}scene") == "refused"
    blind = "async (address) => { const r = await fetch(address, {method: 'POST', mode: 'no-cors', body: '{}'}).catch(() => null); return r && r.type; }"
    assert foreign.evaluate(blind, f"{page.address}scene") in (None, "opaque")
    assert foreign.goto(f"http://127.0.0.1:{port}/").status == 403
    assert foreign.goto(f"http://127.0.0.1:{port}/{'x' * 32}/").status == 403
    context.close()


def test_traces_are_zoomed_by_a_drag_and_whole_again_by_a_double_click(tab):
    over = tab.page.locator("#panels .u-over").first
    box = over.bounding_box()
    whole = tab("[plots[0].scales.x.min, plots[0].scales.x.max]")
    tab.page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 40)
    tab.page.mouse.down()
    tab.page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 45, steps=4)
    tab.page.mouse.up()
    tab.until(
        "plots.every((plot) => plot.scales.x.max < 0.7 * live.end) && plots[0].data[0].length > 500 && plots[0].data[0][0] > 0.4 * live.end"
    )
    low, high = tab("[plots[0].scales.x.min, plots[0].scales.x.max]")
    assert (low, high) == (pytest.approx(60, abs=1), pytest.approx(72, abs=1)) and whole == [0, 120]
    tab.type("bit.weight", "90")  # the window stays while a number is turned
    tab.until("plots[0].data[0].length > 500 && plots[0].data[0][0] > 0.4 * live.end")
    assert tab("[plots[0].scales.x.min, plots[0].scales.x.max]") == [low, high]
    over.dblclick()
    tab.until("plots.every((plot) => plot.scales.x.min === 0 && plot.scales.x.max === live.end)")


@pytest.mark.parametrize("kind", [PHONE, {"color_scheme": "dark"}, {**PHONE, "color_scheme": "dark"}], ids=["phone", "dark", "phone, dark"])
def test_a_phone_scrolls_one_way_only_and_the_dark_has_a_dark_paper(browser, page, kind):
    with Tab(browser, page.address, **kind) as tab:
        tab.until("map !== null && Boolean(map.axes)")
        assert tab("document.documentElement.scrollWidth <= innerWidth")
        brightness = tab("getComputedStyle(document.body).backgroundColor.match(/[0-9]+/g).slice(0, 3).map(Number).reduce((a, b) => a + b)")
        assert (brightness < 150) == (kind.get("color_scheme") == "dark")
        tab.page.get_by_role("slider", name="bit.weight").first.fill("60")
        tab.settle()
        assert tab.setting["changes"]["bit.weight"] == pytest.approx(60e3) and tab.said == []


def test_two_hundred_actions_at_random_leave_the_console_silent(tab, page):
    draw, canvas = random.Random(7), tab.page.locator("#map")
    for _ in range(200):
        match draw.randrange(9):
            case 0:
                tab.page.select_option("#law", draw.choice(tab("Object.keys(told.laws)")))
            case 1 | 2 | 3:
                slider = tab.page.locator("#numbers input[type=range]:enabled").nth(draw.randrange(8))
                slider.evaluate("(each, part) => { each.value = Number(each.min) + part * (each.max - each.min); each.dispatchEvent(new Event('input')); }",
                                draw.random())  # fmt: skip
            case 4:
                button = draw.choice(["undo", "reset", "pin", "rock", "bump", "play"])
                if tab.page.locator(f"#{button}").is_enabled():
                    tab.page.click(f"#{button}")
            case 5:
                size = canvas.bounding_box()
                canvas.click(position={"x": draw.uniform(1, size["width"] - 1), "y": draw.uniform(1, size["height"] - 1)})
            case 6:
                tab.page.fill("#search", draw.choice(["", "friction", "gain", "speed start", "nothing like it"]))
            case 7:
                box = tab.page.locator("#numbers input[type=text]").first
                box.fill(draw.choice(["12 klbf", "-5", "1e400", "NaN", "bananas", "", "90", "<b>", "7e4 N"]))
                box.press("Enter")
            case 8:
                tab.page.locator("#axis-y").select_option(index=draw.randrange(2))
    tab.settle()
    tab.until("!running")
    assert tab.said == []
    found = page._answer("run", {"setting": tab.setting}) if not tab.page.locator("#said.wrong").count() else None
    assert found is None or (found["verdict"], found["print"]) == (tab.page.inner_text("#word"), tab.print)


def test_the_scene_that_is_saved_has_the_verdict_that_is_shown(tab, tmp_path):
    tab.page.select_option("#law", "stiff PI")
    tab.settle()
    tab.type("bit.weight", "60")
    with tab.page.expect_download() as download:
        tab.page.click("#save-scene")
    download.value.save_as(tmp_path / "scene.toml")
    saved = Scene.load(tmp_path / "scene.toml")
    assert verdict_of(saved, saved.run("stiff PI"))[0] == tab.page.inner_text("#word")


def test_every_scene_of_the_studies_opens_and_shows_its_verdict(browser):
    """A brake that stops, inputs that vary in time, and a contact without modes."""
    for name in ("brake_laws", "popp_rudolph", "lugre_guide"):
        with explore(Scene.load(SCENES / f"{name}.toml"), port=0) as served, Tab(browser, served.address) as tab:
            assert tab.page.locator("#said.wrong").count() == 0, tab.page.inner_text("#said")
            tab.followed()
            assert tab("live.verdict") == tab.page.inner_text("#word") != "..." and tab("live.whole") and tab.said == []
