"""The page without a browser: who may ask, and that what it answers is what the toolbox says."""

import base64
import gc
import http.client
import json
import math
import random
import signal
import socket
import subprocess
import sys
import threading
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from tests.plants import BELT
from toolbox import Scene, closed_loop, measure, simulate
from toolbox.commands.command_line import main
from toolbox.errors import SceneError
from toolbox.messages import step_here
from toolbox.onsets.verdicts import verdict_of, words_of
from toolbox.page import answers, explore, maps
from toolbox.page.controls import controls_of
from toolbox.page.served import SOON, page_of
from toolbox.page.server import FILES, LONGEST
from toolbox.scenes.judged import sticks_before_standstill
from toolbox.simulation.run import Budget

SCENES = Path(__file__).parents[2] / "studies" / "scenes"


def request(page, question, body=None, path=None, **headers):
    """(status, headers, bytes) of one request of a browser that has the address."""
    host = f"127.0.0.1:{page.server.server_address[1]}"
    own = {"Host": host, **({} if body is None else {"Origin": f"http://{host}"})} | {
        name: value for name, value in headers.items() if value is not None
    }
    for name in headers:
        if headers[name] is None:
            own.pop(name, None)
    connection = http.client.HTTPConnection(host, timeout=60)
    connection.putrequest("GET" if body is None else "POST", f"/{page.server.token}/{question}" if path is None else path, skip_host=True)
    for name, value in own.items():
        connection.putheader(name, value)
    if body is not None:
        connection.putheader("Content-Length", str(len(body)))
    connection.endheaders(body)
    answer = connection.getresponse()
    found = answer.status, answer.headers, answer.read()
    connection.close()
    return found


def ask(page, question, /, **told):
    status, headers, body = request(page, question, json.dumps(told).encode())
    assert status == 200, body
    if headers["Content-Type"] == "application/x-ndjson":
        return [json.loads(line) for line in body.splitlines()]
    return body if headers["Content-Type"] == "application/octet-stream" else json.loads(body)


def run(page, label="soft torque", changes=None, disturbance=""):
    return ask(page, "run", setting={"label": label, "changes": changes or {}, "disturbance": disturbance})


def floats(text):
    return np.frombuffer(base64.b64decode(text), "<f4")


# ------------------------------------------------------------------------------------------------------------------------------- who may ask
def test_every_file_of_the_page_is_given_to_who_has_the_token_and_runs_no_foreign_code(page):
    for name in FILES:
        status, headers, body = request(page, name)
        assert status == 200 and body and "script-src 'self';" in headers["Content-Security-Policy"]
    assert b"https://" not in request(page, "")[2] and b"http://" not in request(page, "")[2]


@pytest.mark.parametrize("path", ["/", "/index.html", "/wrong/", "/wrong/run", "//", "/%2e%2e/"])
def test_without_its_token_nothing_is_given(page, path):
    assert request(page, "", path=path)[0] == 403
    assert request(page, "", b"{}", path=path)[0] == 403


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8790", "127.0.0.1", "127.0.0.1:1", None])
def test_a_foreign_host_is_refused(page, host):
    assert request(page, "", Host=host)[0] == 403
    assert request(page, "scene", b"{}", Host=host)[0] == 403


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1", "https://127.0.0.1", None])
def test_a_foreign_origin_is_refused(page, origin):
    assert request(page, "scene", b"{}", Origin=origin)[0] == 403


def test_nothing_that_is_sent_becomes_a_path_or_more_than_data(page):
    for name in ("../page.py", "web/../../server.py", "%2e%2e/server.py", "/etc/passwd", "server.py"):
        assert request(page, name)[0] == 404
    assert request(page, "__class__", b"{}")[0] == 404
    assert request(page, "run", b"{")[0] == 400
    assert request(page, "run", b"[" * 100_000)[0] == 400
    assert request(page, "run", b" " * (LONGEST + 1))[0] == 413
    for setting in (None, [], {"label": "x"}, {"label": ["soft torque"]}, {"label": "soft torque", "changes": {"bit.weight": [1]}},
                    {"label": "soft torque", "changes": {"bit.weight": True}}, {"label": "soft torque", "disturbance": "__import__"}):  # fmt: skip
        assert "error" in ask(page, "run", setting=setting), setting
    assert "error" in ask(page, "map", setting={"label": "soft torque"}, axes=["bit.weight", "bit.weight"])


def test_a_port_that_is_taken_is_no_error(scene):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        other = explore(scene, port=port)
        assert other.server.server_address[1] != port and request(other, "")[0] == 200
        other.close()


# ------------------------------------------------------------------------------------------------------------------------------- what it answers
def test_every_number_that_acts_is_a_control_once_with_its_value_in_range(page, scene):
    told = ask(page, "scene")
    assert list(told["laws"]) == scene.labels
    for label in scene.labels:
        controls = told["laws"][label]["controls"]
        names = [each["name"] for each in controls]
        hidden = scene[label].variable_numbers().keys() - set(names)
        assert len(names) == len(set(names)) and hidden <= {"chain.speed.0", "chain.speed.1"}
        for each in controls:
            number = scene[label].number(each["name"])
            assert each["low"] < each["high"] and each["step"] > 0
            assert each["low"] - each["step"] <= number.value * each["factor"] <= each["high"] + each["step"], each
    weight = next(each for each in told["laws"]["soft torque"]["controls"] if each["name"] == "bit.weight")
    assert weight["unit"] == "kN" and weight["first"]


def test_controls_stand_in_the_order_in_which_they_are_turned_with_start_values_last(scene):
    controls = controls_of(scene["soft torque"], {})
    starts = [each.number.is_start for each in controls]
    assert 0 < sum(starts) < len(starts) and starts == sorted(starts)
    places = {each.number.name: k for k, each in enumerate(controls)}
    assert places["bit.weight"] < places["bit.friction.static"] < places["chain.stiffness.0"]


def settings(page, count, seed):
    """Settings drawn at random, over laws, numbers and the ranges of their sliders."""
    draw, laws = random.Random(seed), ask(page, "scene")["laws"]
    for _ in range(count):
        label = draw.choice([*laws])
        controls = [each for each in laws[label]["controls"] if each["kind"] != "start" and each["name"] not in laws[label]["without"]]
        some = draw.sample(controls, 3)
        yield label, {each["name"]: draw.uniform(0.7 * each["low"] + 0.3 * each["high"], 0.4 * each["low"] + 0.6 * each["high"]) / each["factor"]
                      for each in some}  # fmt: skip


def agree(page, tmp_path, count, seed):
    verdicts = set()
    for label, changes in settings(page, count, seed):
        found = run(page, label, changes)
        text = ask(page, "save_scene", setting={"label": label, "changes": changes})
        if "error" in found:  # numbers that do not go together
            assert "error" in text, (label, changes)
            continue
        path = tmp_path / "scene.toml"
        path.write_text(text["text"], encoding="utf-8")
        again = Scene.load(path)
        said = again.run(again.labels[0])
        assert verdict_of(again, said)[0] == found["verdict"], (label, changes)
        assert floats(found["signals"][0]["values"])[-1] == pytest.approx(
            said["bit.speed"][-1] * found["signals"][0]["factor"], rel=1e-5, abs=1e-3
        )
        verdicts.add(found["verdict"])
    return verdicts


def test_the_verdict_is_that_of_the_scene_that_is_saved(page, tmp_path):
    assert len(agree(page, tmp_path, 8, seed=1)) >= 2


@pytest.mark.slow
def test_the_verdict_is_that_of_the_scene_at_fifty_settings(page, tmp_path):
    assert len(agree(page, tmp_path, 50, seed=2)) >= 3


def test_undoing_gives_the_earlier_answer_again(page):
    before = run(page, "stiff PI")
    for k in range(20):  # more than the page keeps
        assert run(page, "stiff PI", {"top.reference": 12.0 + 0.1 * k})["print"] != before["print"]
    after = run(page, "stiff PI")
    assert {**after, "milliseconds": 0} == {**before, "milliseconds": 0}


def test_text_with_a_unit_is_understood_and_what_is_wrong_is_said(page):
    assert run(page, changes={"top.reference": "120 rpm"})["print"] == run(page, changes={"top.reference": 4 * np.pi})["print"]
    assert "`bit.weight` must be >= 0 N" in run(page, changes={"bit.weight": -1.0})["error"]
    assert "`top.reference`" in run(page, changes={"top.reference": "12 bananas"})["error"]
    assert run(page, "constant torque", {"stiffpi.proportional": 100.0, "bit.weight": 9e4})["lacking"] == ["stiffpi.proportional"]


def test_a_number_that_an_input_takes_the_place_of_is_told_with_the_reason(page):
    found = ask(page, "further", setting={"label": "stiff PI", "changes": {"top.reference": 12.0}})
    assert "`top.reference` overrides it" in found["without"]["stiffpi.reference"]
    one, other = ({"top.reference": 12.0, "stiffpi.reference": value} for value in (5.0, 9.0))
    assert run(page, "stiff PI", one)["print"] == run(page, "stiff PI", other)["print"]
    assert found["inexact"] < 1e-4 and len(found["poles"]) >= 4 and "stable" in found["poles_words"]


def test_sticks_and_traces_are_those_of_the_run(page, scene):
    found, made = run(page, "stiff PI"), scene.run("stiff PI")
    assert found["sticks"] == [[a, b] for a, b, mode in made.intervals("bit") if mode == "stick"]
    time = floats(found["time"])
    assert time.size >= 900 and (np.diff(time) >= 0).all() and time[-1] == 120.0
    for each in found["signals"]:
        exact = made.at(np.minimum(time.astype(float), 120.0))[each["name"]] * each["factor"]
        away = np.abs(floats(each["values"]) - exact)
        assert np.median(away) < 1e-4 * np.abs(exact).max(), each["name"]
    frequency, amplitude = (floats(found["spectrum"][each]) for each in ("frequency", "amplitude"))
    assert frequency[amplitude.argmax()] == pytest.approx(1 / found["period"], rel=0.15)


@pytest.mark.parametrize("kind", ["rock", "bump"])
def test_a_disturbance_shakes_the_machine_after_its_moment_only(page, kind):
    calm, shaken = run(page), run(page, disturbance=kind)
    before = floats(calm["time"]) < calm["after"]
    one, other = (
        np.interp(np.linspace(0, 120, 500), floats(each["time"]), floats(each["signals"][0]["values"])) for each in (calm, shaken)
    )
    early = np.linspace(0, 120, 500) < calm["after"] - 1.0
    assert before.any() and np.abs(one - other)[early].max() < 0.5 < np.abs(one - other)[~early].max()


def test_maps_come_coarse_first_and_end_when_the_page_asks_for_another(page):
    told = {"setting": {"label": "soft torque"}, "axes": ["top.reference", "bit.weight"], "page": "a"}
    found = page._questions["map"](told)
    first = next(found)
    assert first["points"] == 5 and first["units"] == ["rpm", "kN"] and first["borders"]["smooth"] and first["borders"]["sticking"]
    page._questions["map"]({**told, "setting": {"label": "stiff PI"}})
    assert [*found] == []
    other = page._questions["map"]({**told, "page": "b"})
    assert next(other)["points"] == 5
    page._questions["leave"]({"page": "b"})
    assert [*other] == []


def test_a_map_waits_while_numbers_are_turned(page):
    told = {"setting": {"label": "soft torque"}, "axes": ["top.reference", "bit.weight"], "page": "waits"}
    found, came = page._questions["map"]({**told, "setting": {"label": "soft torque", "changes": {"top.reference": 11.0}}}), []
    reader = threading.Thread(target=lambda: came.append(next(found)))
    with page._first():
        reader.start()
        reader.join(0.5)
        assert came == []
        assert run(page, "soft torque", {"bit.weight": 71e3})["verdict"]  # nobody else waits
    reader.join(60.0)
    assert came[0]["points"] == 5
    page._questions["leave"]({"page": "waits"})


def test_lines_of_python_and_the_saved_run_are_the_same_run(page, tmp_path, monkeypatch, scene):
    changes = {"softtorque.sample_time": 0.02, "bit.weight": 8e4, "stiffpi.proportional": "3 kN m s/rad"}
    setting = {"label": "softer PI, 100 Hz", "changes": changes, "disturbance": "rock"}
    path = tmp_path / "run.npz"
    path.write_bytes(ask(page, "save_run", setting=setting))
    text = ask(page, "python", setting=setting)["text"]
    names = {"loop": scene["softer PI, 100 Hz"]}
    exec(text.replace("print(run)\nrun.plot()\n", ""), names)
    with np.load(path) as data:
        assert np.array_equal(names["run"].time, data["time"]) and np.array_equal(names["run"]["bit.speed"], data["bit.speed"])


def test_a_notebook_gets_a_frame_and_a_sentence_for_a_remote_one():
    with pytest.raises(SceneError, match="`duration` must be given"):
        explore(closed_loop(BELT))
    with explore(BELT, "20 s", port=0) as page:
        assert f'<iframe src="{page.address}"' in page._repr_html_() and "ssh -L" in page._repr_html_() and page.address in str(page)
        found = run(page, "loop")
        assert found["verdict"] == "stick-slip" and found["element"] == "belt"
        assert found["sticks"] == [[a, b] for a, b, mode in simulate(BELT, 20.0).intervals("belt") if mode == "stick"]
        assert "scene" not in ask(page, "python", setting={"label": "loop", "changes": {"block.mass": 2.0}})["text"].lower()
        assert "BlockOnBelt" in ask(page, "save_scene", setting={"label": "loop"})["text"]


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_the_command_prints_its_address_and_ends_with_its_terminal():
    line = [sys.executable, "-m", "toolbox", "explore", str(SCENES / "block_on_belt.toml"), "--no-browser", "--port", "0"]
    with subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline().startswith("http://127.0.0.1:")
        process.send_signal(signal.SIGINT)
        assert process.wait(30) == 130 and process.stderr.read() == "stickslip: the page has ended.\n"


@pytest.mark.slow
def test_memory_stays_flat(page):
    """What Python and numpy hold, which is the same each time; what the process has besides goes up and down by tens of megabytes."""
    draw, sizes = random.Random(3), []
    tracemalloc.start()
    try:
        for k in range(400):
            run(page, "softer PI, 100 Hz", {"top.reference": draw.uniform(5, 15), "bit.weight": draw.uniform(5e4, 1.5e5)})
            if k in (100, 399):
                gc.collect()
                sizes.append((tracemalloc.get_traced_memory()[0], len(gc.get_objects())))
    finally:
        tracemalloc.stop()
    assert sizes[1][0] - sizes[0][0] < 10e6  # 300 runs, of which each holds a megabyte and twelve are kept
    assert sizes[1][1] - sizes[0][1] < 2000


@pytest.mark.parametrize("name", ["brake_laws", "popp_rudolph", "den_hartog", "hoisting", "breaking_circulation", "creep_groan"])
def test_a_scene_whose_inputs_vary_in_time_opens(name):
    served = page_of(Scene.load(SCENES / f"{name}.toml"), None, None, 0)
    told = served._answer("scene", {})
    served.server.server_close()
    assert json.dumps(told, allow_nan=False) and any(law["moving"] for law in told["laws"].values())


def test_a_run_that_takes_longer_than_a_moment_is_said_to_and_then_given(page, monkeypatch):
    monkeypatch.setattr("toolbox.page.served.Budget", lambda seconds: Budget(steps=5) if seconds == SOON else Budget(seconds=seconds))
    setting = {"label": "soft torque", "changes": {"bit.weight": 87_654.0}}
    assert "takes a while" in ask(page, "run", setting=setting, soon=True)["waiting"]
    assert ask(page, "run", setting=setting)["whole"]


def test_a_verdict_that_takes_longer_than_a_moment_follows_the_run(page, monkeypatch):
    seen = threading.Event()

    def long(loop, run, found):
        while not seen.is_set():
            step_here()()
        return words_of(loop, run, found)

    monkeypatch.setattr(answers, "words_of", long)
    setting = {"label": "softer PI, 100 Hz", "changes": {"bit.weight": 87_655.0}}
    first = ask(page, "run", setting=setting, soon=True)
    assert (first["verdict"], first["decided"], first["whole"]) == ("not decided yet", False, True)
    assert "being looked at" in first["reason"] and first["measures"] and first["signals"]
    seen.set()
    last = ask(page, "run", setting=setting)
    assert last["decided"] and last["verdict"] != first["verdict"] and last["print"] == first["print"]


def test_what_a_page_waits_for_ends_when_it_asks_for_another_run_or_goes(page, monkeypatch):
    page.warming.join()
    begun = threading.Barrier(2)

    def judging(loop, run, found):
        begun.wait(60.0)
        while True:
            step_here()()
            time.sleep(0.001)

    def waiting(name):
        came = []
        asks = threading.Thread(target=lambda: came.append(ask(page, "run", page=name, setting={"label": "stiff PI"})), daemon=True)
        asks.start()
        begun.wait(60.0)
        return asks, came

    with monkeypatch.context() as patched:
        patched.setattr(answers, "words_of", judging)
        (first, one), (second, two) = waiting("one"), waiting("two")
    assert ask(page, "run", page="one", setting={"label": "soft torque"})["decided"]
    first.join(60.0)
    assert one == [{"cancelled": True}] and second.is_alive()
    ask(page, "leave", page="two")  # its map alone
    assert second.is_alive()
    ask(page, "leave", page="two", gone=True)
    second.join(60.0)
    assert two == [{"cancelled": True}]


def test_a_stop_tells_of_the_sticks_before_it_stands_and_has_no_map():
    scene = Scene.load(SCENES / "brake_laws.toml")
    with explore(scene, port=0) as served:
        found, told = run(served, "constant force"), ask(served, "scene")["laws"]["constant force"]
    sticks = sticks_before_standstill(scene.run("constant force"), "pad", "disc.speed", scene.standstill_speed, scene.after)
    assert f"sticks {len(sticks)} times" in found["reason"] and f"{max(b - a for a, b in sticks):.3g} s at the longest" in found["reason"]
    assert max(b - a for a, b in sticks) < 0.5 and told["still"] and told["axes"] == []


def test_a_stop_tells_its_way_and_what_its_contact_sounds_like_until_it_stands():
    """The pad groans somewhat below the 50 Hz at which it swings while it slips."""
    scene = Scene.load(SCENES / "brake_laws.toml")
    with explore(scene, port=0) as served:
        found, more = (
            run(served, "constant force"),
            ask(served, "further", setting={"label": "constant force", "changes": {}, "disturbance": ""}),
        )
    told = dict(found["measures"])
    stopped = scene.run("constant force")
    times = np.linspace(0.0, measure.standstill(stopped, "disc.speed", scene.standstill_speed, after=scene.after), 20_001)
    way = np.trapezoid(stopped.at(times)["disc.speed"], times)
    assert told["stands at"] == f"{times[-1]:.3g} s" and told["stopping distance"].startswith(
        f"{way:.4g} rad ({way / (2 * math.pi):.3g} turns), "
    )
    slowed = stopped.at(0.0)["disc.speed"] / times[-1]
    assert told["stopping distance"].endswith(f", {slowed:.3g} rad/s2 in the mean")
    high, peak = stopped.signal_limits["brake.force"][1], np.abs(stopped["brake.force"]).max()
    assert told["peak of brake.force"] == f"{peak:.4g} N, {100 * peak / high:.3g} % of its limit"
    assert 30.0 < found["spectrum"]["tone"] < 60.0
    frequency, amplitude = (floats(found["spectrum"][each]) for each in ("frequency", "amplitude"))
    assert found["spectrum"]["signal"] == "pad.slip" and 30.0 < frequency[np.argmax(np.where(frequency > 10.0, amplitude, 0.0))] < 60.0
    assert more["poles"] == [] and "standstill" in more["poles_words"]


def test_the_peak_of_a_motor_before_its_gear_stands_beside_its_limit():
    scene = Scene.load(SCENES / "top_drive.toml")
    with explore(scene, port=0) as served:
        told = dict(run(served, "soft torque")["measures"])
    seen = measure.extent(scene.run("soft torque"), "drive.torque")
    peak, (low, high) = max(-seen.minimum, seen.maximum), scene.run("soft torque").signal_limits["drive.torque"]
    assert told["peak of drive.torque"] == f"{1e-3 * peak:.4g} kN m, {100 * peak / high:.3g} % of its limit" and low == -high
    assert "limit" not in told["peak of top.torque"]


def test_natural_frequencies_and_damping_ratios_are_those_of_the_poles(page, scene):
    told = ask(page, "further", setting={"label": "stiff PI", "changes": {}, "disturbance": ""})
    swinging = [complex(*pole) for pole in told["poles"] if pole[1] > 1e-9]
    assert len(swinging) == 1
    size, damping = abs(swinging[0]), -100.0 * swinging[0].real / abs(swinging[0])
    assert f"{size / (2 * math.pi):.3g} Hz ({size:.3g} rad/s), damping {damping:.2g} %" in told["poles_words"]
    answered = run(page, "stiff PI")
    assert answered["spectrum"]["tone"] == pytest.approx(1.0 / answered["period"], rel=0.01)
    found = dict(answered["measures"])
    seen = measure.extent(scene.run("stiff PI"), "bit.speed", scene.after)
    assert found["bit.speed"] == " to ".join(f"{value * 30 / math.pi:z.3g}" for value in (seen.minimum, seen.maximum)) + " rpm"


def test_a_brake_that_is_held_at_a_speed_has_a_map_of_its_groan(monkeypatch):
    opened = []

    def page_of(scene, path, system, port):
        opened.append((scene, path))
        raise SceneError("no page here")

    monkeypatch.setattr("toolbox.page.served.page_of", page_of)
    assert main(["explore", str(SCENES / "brake_stop.toml"), "--law", "HeldSpeed", "--duration", "10 s"]) == 2
    assert main(["explore", str(SCENES / "brake_stop.toml")]) == 2
    (held, elsewhere), (stop, path) = opened
    assert elsewhere is None and path == str(SCENES / "brake_stop.toml") and stop.standstill_speed == 0.1
    assert held.labels == ["HeldSpeed"] and (held.standstill_speed, held.duration, held.after) == (None, 10.0, 5.0)
    monkeypatch.undo()
    with explore(held, port=0) as served:
        law = ask(served, "scene")["laws"]["HeldSpeed"]
        assert sorted(law["axes"]) == ["brake.force", "disc.reference"]
        assert {each["unit"] for each in law["controls"] if each["name"] == "disc.reference"} == {
            "rad/s"
        }  # as figures and reports of a brake


def test_the_range_of_a_map_ends_where_the_machine_is_none():
    """A kinetic friction above the static one is refused."""
    scene = Scene.load(SCENES / "elastic_pad.toml")
    loop = scene[scene.labels[0]]
    controls = {each.number.name: each for each in controls_of(loop, {})}
    low, high = maps.ranges(controls, ["disc.speed", "pad.friction.kinetic"], loop)["pad.friction.kinetic"]
    static = loop.number("pad.friction.static").value
    assert low < loop.number("pad.friction.kinetic").value and 0.98 * static < high <= static
