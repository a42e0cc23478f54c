"""A page on which the numbers of a closed loop are turned, and what one sees is simulated at once.

Why no framework of pages, such as Panel: it would install 213 MB; the page is a few files and a server of the standard library.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
import os
import tempfile
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

from toolbox.arguments import number
from toolbox.errors import BudgetError, SceneError, SimulationError
from toolbox.files.unit_systems import use_units
from toolbox.files.units import NumberOrText
from toolbox.messages import at_every_step
from toolbox.modelling.closed_loop import ClosedLoop, as_loop, why_without_effect
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.page import answers, maps
from toolbox.page.controls import Control, controls_of
from toolbox.page.server import Server, in_background
from toolbox.page.setting import Setting, disturbing, python_of, scene_of
from toolbox.scenes.judged import judged_contact, judged_effort, judged_speed
from toolbox.scenes.scene import Scene
from toolbox.simulation.budget import Budget
from toolbox.simulation.methods import EventExact
from toolbox.simulation.request import accuracy_of
from toolbox.simulation.simulate import simulate
from toolbox.simulation.trajectory import Trajectory

PORT = 8790
"""The port that is tried first."""

KEPT = 12
"""Runs that the page keeps."""

SOON = 0.3
"""Seconds after which a run that is not finished is shown as far as it is."""

AT_ONCE = 0.06
"""Seconds, or as long again as the run took, after which it is shown without its verdict where the judge is not at the end: one waits for the run."""

PAGES = 100
"""Pages whose last question is known."""

QUIET = 0.3
"""Seconds without a run after which maps are drawn on: while somebody turns a number, the processor is for the run that he waits for."""

LEAVING = 5.0
"""Seconds that the end of a page waits for the run that is being made ready."""

PATIENCE = 120.0
"""Seconds that a run may take."""


class _Cancelled(Exception):
    """Nobody waits for this map, or this answer, any more."""


class Page:
    """Web page that `explore` serves until its process ends, or until `close` is called. A notebook shows the page in a frame.

    Attributes
    ----------
    address
        Address of the page for a browser on this computer, with the secret token.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose
    >>> from toolbox.page import explore
    >>> page = explore(compose(BlockOnBelt()), "60 s")
    >>> print(page.address.startswith("http://127.0.0.1:"))
    True
    >>> page.close()
    """

    def __init__(self, loops: Mapping[str, ClosedLoop], scene: Scene | None, path: str | None, system: str | None, port: int):
        self.loops, self.scene, self.path, self.system = dict(loops), scene, path, system
        self._lock, self._runs = threading.Lock(), OrderedDict[str, tuple[Trajectory, ClosedLoop, list[str]]]()
        self._looks: dict[str, dict[str, Any]] = {}
        self._maps: dict[str, object] = {}
        self._waiting: dict[str, object] = {}
        self._drawn: OrderedDict[str, dict[str, Any]] = OrderedDict()
        self._closed = False
        self._turned, self._running = -math.inf, 0
        self._questions = {
            "scene": self._scene,
            "run": self._run,
            "further": self._further,
            "traces": self._traces,
            "map": self._map,
            "leave": self._leave,
            "save_scene": self._save_scene,
            "save_run": self._save_run,
            "python": self._python,
        }
        self.server = Server(self._answer, port)
        self.warming: threading.Thread | None = None

    @property
    def address(self) -> str:
        """Address of the page for a browser on this computer, with the secret token."""
        return self.server.address

    def close(self) -> None:
        """Stop serving the page."""
        self._maps.clear()
        self._closed = True
        self.server.shutdown()
        self.server.server_close()
        if self.warming is not None:
            self.warming.join(LEAVING)

    def __enter__(self) -> Page:
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()

    def _repr_html_(self) -> str:
        address = escape(self.address)
        port = self.server.server_address[1]
        remote = (
            f"Where this frame stays empty, the notebook runs on another computer: forward the port (<code>ssh -L {port}:127.0.0.1:{port} HOST</code>) "
            f'and open <a href="{address}">{address}</a>.'
        )
        frame = f'<iframe src="{address}" title="stickslip explore" width="100%" height="900" style="border:1px solid #8888"></iframe>'
        elsewhere = "JUPYTERHUB_SERVICE_PREFIX" in os.environ or "SSH_CONNECTION" in os.environ
        return f"<p>{remote}</p>{frame}" if elsewhere else f"{frame}<p><small>{remote}</small></p>"

    def __str__(self) -> str:
        return f"Page of {', '.join(self.loops)}: {self.address}"

    __repr__ = __str__

    # ------------------------------------------------------------------------------------------------------------------------------- questions
    def _answer(self, question: str, told: Any) -> Any:
        """What the page gets; raises KeyError for what is no question."""
        asking = self._questions[question]
        if not isinstance(told, dict):
            raise SceneError("A question must be an object, but it is none.")
        with contextlib.nullcontext() if self.system is None else use_units(self.system):
            return asking(told)

    def _look(self, label: str) -> dict[str, Any]:
        """What stays while numbers of a loop are turned: its controls, its units, and the signals that are shown."""
        with self._lock:
            if label not in self._looks:
                loop = self.loops[label]
                usual = {"rad/s": "rpm"} if loop.plant.has_signal("top.speed") else {}  # of a drill string, where nobody typed another unit
                asked = {**usual, **(self.scene.display_units if self.scene is not None else loop.display_units)}
                controls = {control.number.name: control for control in controls_of(loop, asked)}
                axes = [] if loop.standstill_speed is not None else maps.axes_of([*controls.values()])
                self._looks[label] = {"asked": asked, "controls": controls, "axes": axes,
                                      "redone": {name: each.kind.redesigns for name, each in loop.variable_numbers().items()}}  # fmt: skip
        return self._looks[label]

    def _scene(self, told: dict[str, Any]) -> dict[str, Any]:
        """What there is: laws, their controls, and what a map may be over."""
        laws = {}
        for label, loop in self.loops.items():
            look = self._look(label)
            able = [name for name, each in look["controls"].items() if each.number.kind.borders and each.number.overridden is None]
            disturbances: dict[str, Any] = {}
            for kind in ("rock", "bump"):
                try:
                    disturbances[kind] = {"names": disturbing(loop, kind)}
                except SceneError as refusal:
                    disturbances[kind] = {"names": [], "why": str(refusal)}
            moving = {name: None for name, value in loop.input_values.items() if not isinstance(value, float)}
            laws[label] = {
                "controls": [control.told() for control in look["controls"].values()], "axes": look["axes"], "able": able,
                "still": loop.standstill_speed is not None, "moving": [*moving],
                "values": {name: each.number.value for name, each in look["controls"].items() if math.isfinite(each.number.value)},
                "without": {name: f"No effect: {why_without_effect(loop, taking)}." for name, taking in loop.overriding_inputs.items()},
                "disturbances": disturbances,
            }  # fmt: skip
        title = self.scene.title if self.scene is not None else next(iter(self.loops.values())).title
        return {"title": title, "laws": laws, "saves": self.scene is not None}

    def _simulated(self, told: dict[str, Any], soon: bool = False) -> tuple[Trajectory, ClosedLoop, list[str], bool]:
        """The run of a setting, its loop, the numbers that its law lacks, and whether the run is whole; soon: as far as it comes in a moment."""
        setting = Setting.of(told.get("setting"), self.loops)
        with self._lock:
            known = self._runs.get(setting.key)
            if known is not None:
                self._runs.move_to_end(setting.key)
                return *known, True
        loop, without = setting.loop(self.loops[setting.label], self._look(setting.label)["redone"])
        try:
            run = simulate(loop, method=EventExact(budget=Budget(seconds=SOON if soon else PATIENCE)))
        except SimulationError as failure:
            if not soon or failure.run is None or failure.run.time.size < 2 or failure.run.end <= (loop.after or 0.0):
                raise
            return failure.run, loop, without, False
        with self._lock:
            self._runs[setting.key] = run, loop, without
            while len(self._runs) > KEPT:
                self._runs.popitem(last=False)
        return run, loop, without, True

    def _run(self, told: dict[str, Any]) -> dict[str, Any]:
        """Traces and verdict of a setting; of one that is asked for soon, as much as there is in a moment. What the same page waited for before ends."""
        with self._lock:
            _newest(self._waiting, _page(told))
        with self._first():
            return self._while_wanted(told, lambda step: self._shown(told, bool(told.get("soon")), step))

    def _while_wanted(self, told: dict[str, Any], work: Callable[[Callable[[], None]], dict[str, Any]]) -> dict[str, Any]:
        """What a piece of work finds, given a function to call at its steps; it ends once the page of the question asks for another run."""
        page = _page(told)
        mine = self._waiting.get(page)

        def step() -> None:
            if self._closed or (page and self._waiting.get(page) is not mine):
                raise _Cancelled

        try:
            with at_every_step(step):
                return work(step)
        except _Cancelled:
            return {"cancelled": True}

    @contextlib.contextmanager
    def _first(self) -> Iterator[None]:
        """Maps wait meanwhile, and for a moment afterwards."""
        with self._lock:
            self._running += 1
        try:
            yield
        finally:
            with self._lock:
                self._running -= 1
                self._turned = time.monotonic()

    def _shown(self, told: dict[str, Any], soon: bool, wanted: Callable[[], None]) -> dict[str, Any]:
        began = time.monotonic()
        try:
            run, loop, without, whole = self._simulated(told, soon)
        except BudgetError as failure:
            if not soon:
                raise
            return {"waiting": f"The run takes a while: {failure}"}
        label = told["setting"]["label"]
        look = self._look(label)
        if "signals" not in look:
            look["signals"], look["plane"] = answers.shown_signals(run, loop), answers.plane_of(run, loop)
        ran = time.monotonic()
        end = max(began + AT_ONCE, 2.0 * ran - began) if soon else math.inf

        def step() -> None:
            wanted()
            if time.monotonic() > end:
                raise answers.Later

        return answers.answer(run, loop, look["signals"], look["plane"], look["asked"], step) | {"lacking": without, "whole": whole}

    def _traces(self, told: dict[str, Any]) -> dict[str, Any]:
        """The traces between two times, for who looks closer."""
        run, _, _, _ = self._simulated(told)
        look = self._look(told["setting"]["label"])
        begin, end = (number(f"`{word}`", told.get(word), "s") for word in ("begin", "end"))
        return answers.closer(run, look.get("signals", []), (max(begin, run.begin), min(end, run.end)), look["asked"])

    def _further(self, told: dict[str, Any]) -> dict[str, Any]:
        """Error, poles, and what has no effect."""

        return self._while_wanted(told, lambda _: answers.further(*self._simulated(told)[:2]))

    # ------------------------------------------------------------------------------------------------------------------------------------- maps
    def _map(self, told: dict[str, Any]) -> Iterator[dict[str, Any]]:
        """Maps around a setting, one finer than the other, until the same page asks for another one or leaves."""
        setting = Setting.of(told.get("setting"), self.loops)
        look, axes = self._look(setting.label), told.get("axes")
        names = [name for name in axes if isinstance(name, str) and name in look["controls"]] if isinstance(axes, list) else []
        if len(names) != 2 or axes != names or names[0] == names[1]:
            raise SceneError("Argument `axes` must name two numbers of the loop.")
        page = _page(told)
        with self._lock:
            mine = _newest(self._maps, page)
        loop, _ = dataclasses.replace(setting, disturbance="").loop(self.loops[setting.label])
        controls: dict[str, Control] = look["controls"]
        over = maps.ranges(controls, names, loop)
        for name in names:  # the middle of the map takes the place of an input that varies in time
            loop = loop.at(name, sum(over[name]) / 2)
        loop = loop.replace(inputs={name: answers.at_last(value) for name, value in loop.input_values.items()})

        def step() -> None:
            while not self._closed and self._maps.get(page) is mine and (self._running or time.monotonic() < self._turned + QUIET):
                time.sleep(0.02)
            if self._closed or self._maps.get(page) is not mine:
                raise _Cancelled

        def stages() -> Iterator[dict[str, Any]]:
            draw = partial(maps.drawn, loop, over, {name: controls[name].read for name in names})
            with contextlib.suppress(_Cancelled):
                for stage in maps.STAGES:
                    found = self._mapped(repr([setting.key, names, stage]), stage, draw, step)
                    yield found
                    if "error" in found:
                        return

        return stages()

    def _mapped(self, key: str, stage: tuple[int, int], draw: Callable[..., dict[str, Any]], step: Callable[[], None]) -> dict[str, Any]:
        """One map, which is drawn once; step: called at every run, what it raises ends the work."""
        with self._lock:
            if key in self._drawn:
                self._drawn.move_to_end(key)
                return self._drawn[key]
        found = draw(stage, step)
        with self._lock:
            self._drawn[key] = found
            while len(self._drawn) > KEPT:
                self._drawn.popitem(last=False)
        return found

    def warm(self) -> None:
        """Compute the first view of the page in advance, so that all code is compiled before a user waits for it. The
        computation stops when the page is closed.
        """
        told: dict[str, Any] = {"page": "", "setting": {"label": next(iter(self.loops)), "changes": {}, "disturbance": ""}}
        with contextlib.suppress(SceneError, SimulationError):
            self._answer("run", told)
            if self._closed:
                return
            names = self._look(told["setting"]["label"])["axes"]
            if len(names) == 2:
                next(self._answer("map", told | {"axes": names}), None)
            if not self._closed:
                self._answer("further", told)
        for label in [*self.loops][1:]:
            with contextlib.suppress(SceneError, SimulationError):
                if not self._closed:
                    self._answer("run", told | {"setting": {"label": label, "changes": {}, "disturbance": ""}, "soon": True})

    def _leave(self, told: dict[str, Any]) -> dict[str, Any]:
        """Forget the map of a page, and what it waits for, where it has gone."""
        for known in (self._maps, self._waiting) if told.get("gone") is True else (self._maps,):
            known.pop(_page(told), None)
        return {}

    # ----------------------------------------------------------------------------------------------------------------------------------- saving
    def _save_scene(self, told: dict[str, Any]) -> dict[str, str]:
        """The setting as the text of a scene file."""
        setting = Setting.of(told.get("setting"), self.loops)
        loop, _ = setting.loop(self.loops[setting.label])
        with tempfile.TemporaryDirectory(prefix="stickslip-page-") as folder:
            return {"text": scene_of(setting, loop, self.scene).save(Path(folder) / "scene.toml").read_text(encoding="utf-8")}

    def _save_run(self, told: dict[str, Any]) -> bytes:
        """The run of a setting as npz."""
        run, _, _, _ = self._simulated(told)
        with tempfile.TemporaryDirectory(prefix="stickslip-page-") as folder:
            run.save(Path(folder) / "run.npz")
            return (Path(folder) / "run.npz").read_bytes()

    def _python(self, told: dict[str, Any]) -> dict[str, str]:
        """The setting as lines of Python."""
        setting = Setting.of(told.get("setting"), self.loops)
        return {"text": python_of(setting, self.loops[setting.label], self.path)}


def _page(told: dict[str, Any]) -> str:
    """Which page asks; empty where a question does not say."""
    return str(told.get("page", ""))[:40]


def _newest(known: dict[str, object], page: str) -> object:
    """A mark of the newest question of a page, which takes the place of the one before; of many pages those that asked last are known."""
    mine = object()
    known.pop(page, None)
    known[page] = mine
    while len(known) > PAGES:
        del known[next(iter(known))]
    return mine


def explore(loop: ClosedLoop | HybridSystem | Scene, duration: NumberOrText | None = None, *, port: int | None = None) -> Page:
    """Serve a web page on which numbers of a loop can be changed. The page simulates the loop after each change.

    The page shows traces, phase plane, spectrum, poles, the verdict with its reason, and the operating point on a map
    of two numbers with both borders of stick-slip. A notebook shows the page in a frame, and `print` gives its
    address. The page is served to this computer only, from a thread that ends with the process or with
    `page.close()`.

    Parameters
    ----------
    loop
        A closed loop, a plant, or a scene, whose controllers can be chosen on the page.
    duration
        Length of the runs [s], or text with a unit. By default the duration of the scene, for a loop from a scene.
    port
        The port that is tried first, by default 8790. If it is taken, a free port is used.

    Returns
    -------
    Page
        The page. Open its `address` in a browser.

    Raises
    ------
    SceneError
        If the plant has no contact that can stick and no signal is named, or if there is no duration.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose
    >>> from toolbox.page import explore
    >>> page = explore(compose(BlockOnBelt()), "60 s")
    >>> print(page.address.startswith("http://127.0.0.1:"))
    True
    >>> page.close()
    """
    if isinstance(loop, Scene):
        page = page_of(loop if duration is None else lasting(loop, duration), None, None, PORT if port is None else port)
    else:
        judged = _judged(as_loop(loop), duration)
        page = Page({judged.label or "loop": judged}, None, None, None, PORT if port is None else port)
    page.warming = in_background(page.server, page.warm)
    return page


def page_of(scene: Scene, path: str | None, system: str | None, port: int) -> Page:
    """Return the page of a scene, not served yet. path: file of the scene; system: system of units, None for the units that people read."""
    return Page({label: scene[label] for label in scene.labels}, scene, path, system, port)


def lasting(scene: Scene, duration: NumberOrText) -> Scene:
    """A scene whose runs last so long, and are judged from their half on."""
    whole = number("duration", duration, "s", above=0)
    return dataclasses.replace(scene, duration=whole, after=whole / 2)


def _judged(loop: ClosedLoop, duration: NumberOrText | None) -> ClosedLoop:
    """The loop with all that a scene would say of it."""
    given = loop.duration if duration is None else number("duration", duration, "s", above=0)
    if given is None:
        raise SceneError("Argument `duration` must be given: only a loop out of a scene has one of its own.")
    contact = loop.element or (None if loop.signal is not None else judged_contact(loop, sticks=False))
    element = None if contact in loop.system.modeless else contact
    signal = loop.signal or judged_speed(loop, contact or "")
    return loop.replace(
        duration=float(given), after=loop.after if duration is None and loop.after is not None else float(given) / 2, element=element, signal=signal,
        effort=loop.effort or judged_effort(loop.plant, signal), accuracy=accuracy_of(loop),
    )  # fmt: skip
