"""Whatever is sent to the page with its token is answered: by what was asked for, or by an error that says what must hold."""

from __future__ import annotations

import contextlib
import http.client
import json
import logging
import random
import socket

import pytest

from models import BlockOnBelt
from toolbox import compose
from toolbox.page import explore
from toolbox.page.server import HALF_OPEN

QUESTIONS = ("scene", "run", "further", "traces", "map", "leave", "save_scene", "save_run", "python", "nothing", "")
ODD = (
    None, True, False, 0, -1, 3.5, 1e308, -1e-320, 10**400, float("nan"), float("inf"), "", "text", "3 kN", "\ud800", "\0", "x" * 200, [], {}, [[], {}],
    [1, 2], [["a"]], {"a": []}, [None, None], ["block.mass"], ["block.mass", "block.mass"], [[]] * 50,
)  # fmt: skip


@pytest.fixture(scope="module")
def belt():
    with explore(compose(BlockOnBelt()), "2 s", port=0) as served:
        yield served


def drawn(draw, labels, names):
    """A question that is sound, or has odd values at some of its places, or is no question at all."""

    def maybe(sound, part=0.25):
        return draw.choice(ODD) if draw.random() < part else sound

    changes = {draw.choice([*names, "nothing", ""]): maybe(draw.choice((0.5, 1, "2", 0.0)), 0.5) for _ in range(draw.randrange(3))}
    setting = {
        "label": maybe(draw.choice(labels), 0.1),
        "changes": maybe(changes, 0.1),
        "disturbance": maybe(draw.choice(("", "rock", "bump")), 0.1),
    }
    told = {
        "page": maybe("one"), "setting": maybe(setting, 0.1), "soon": maybe(True), "begin": maybe(0.0), "end": maybe(1.0), "gone": maybe(False),
        "axes": maybe([maybe(name) for name in draw.sample(names, 2)], 0.5),
    }  # fmt: skip
    for word in draw.sample(sorted(told), draw.randrange(3)):
        del told[word]
    return draw.choice(QUESTIONS), maybe(told, 0.1)


def answered(connection, page, question, told):
    """(status, first line) of the answer to a question."""
    host = f"127.0.0.1:{page.server.server_address[1]}"
    connection.request("POST", f"/{page.server.token}/{question}", json.dumps(told).encode(), {"Host": host, "Origin": f"http://{host}"})
    answer = connection.getresponse()
    with answer:
        streamed = answer.getheader("Content-Type") == "application/x-ndjson"
        found = answer.status, answer.readline() if streamed else answer.read()
    if streamed:
        connection.close()
    return found


def connected(page):
    return contextlib.closing(http.client.HTTPConnection("127.0.0.1", page.server.server_address[1], timeout=100))


def all_answered(page, count, seed, caplog):
    draw = random.Random(seed)
    label = next(iter(page.loops))
    names = sorted(page._look(label)["controls"])
    kinds = set()
    with connected(page) as connection, caplog.at_level(logging.WARNING, logger="stickslip"):
        for number in range(count):
            question, told = drawn(draw, [*page.loops], names)
            status, body = answered(connection, page, question, told)
            assert status == (404 if question in ("nothing", "") else 200) and body, (number, question, told, body)
            if question not in ("nothing", "", "save_run"):
                kinds.add((question, "error" in json.loads(body)))
    assert not [record for record in caplog.records if record.exc_info]
    assert {("run", True), ("run", False), ("map", True), ("map", False), ("traces", True), ("traces", False)} <= kinds


def test_three_hundred_random_questions_are_answered(belt, caplog):
    all_answered(belt, 300, 1, caplog)


@pytest.mark.filterwarnings("default::RuntimeWarning")  # of numpy, for numbers near the largest that there are
@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_2775_random_questions_are_answered(belt, caplog):
    all_answered(belt, 2775, 2, caplog)


@pytest.mark.parametrize("axes", [[[], {}], [{}, []], [["a"], ["b"]], [None, 1], [1.5, "block.mass"], "ab", {}])
def test_a_map_of_axes_that_are_no_names_gets_an_error(belt, axes):
    with connected(belt) as connection:
        status, body = answered(connection, belt, "map", {"page": "one", "axes": axes, "setting": {"label": next(iter(belt.loops))}})
    assert status == 200 and json.loads(body) == {"error": "Argument `axes` must name two numbers of the loop."}


@pytest.mark.filterwarnings("default::RuntimeWarning")  # of numpy, for numbers near the largest that there are
@pytest.mark.parametrize("force", [1e308, -1e308, 1e200])
def test_a_question_about_forces_near_the_largest_number_gets_an_answer(belt, force):
    setting = {"label": next(iter(belt.loops)), "changes": {"block.stiffness": 0.5, "block.force": force}}
    with connected(belt) as connection:
        status, body = answered(connection, belt, "further", {"page": "one", "setting": setting})
    assert status == 200 and json.loads(body)


def test_a_question_that_fails_for_an_unknown_reason_is_answered_too(belt, monkeypatch, caplog):
    monkeypatch.setitem(belt._questions, "scene", lambda told: 1 // 0)
    with connected(belt) as connection:
        status, _ = answered(connection, belt, "scene", {})
    assert status == 500 and "ZeroDivisionError" in caplog.text


def test_half_open_connections_end_once_there_are_too_many_and_the_user_is_let_in(belt):
    place = belt.server.server_address
    with contextlib.ExitStack() as stack:
        waiting = [stack.enter_context(socket.create_connection(place, timeout=30)) for _ in range(HALF_OPEN + 20)]
        connection = stack.enter_context(connected(belt))
        assert answered(connection, belt, "scene", {})[0] == 200
        assert [each.recv(1) for each in waiting[:20]] == [b""] * 20
        assert len(belt.server._strangers) <= HALF_OPEN
        assert answered(connection, belt, "scene", {})[0] == 200  # a connection that has shown the token is not one of them
