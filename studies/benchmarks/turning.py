"""How long after a key are verdict and traces of the new number painted, on the page of `stickslip explore`?

In Chromium, by playwright: every law of a scene is chosen, the first slider of it gets the focus, and the right arrow is pressed so many times, each time
when the answer before is painted and a moment has passed, in which the map is drawn on. A time reaches from the event of the key to the second frame after
the page has drawn the answer. Where the judge needs longer than the page waits for him, the run is painted first, with "not decided yet" for its verdict: how
often, and when the last of these verdicts came, stands beside it, and the processor time of this process for the same turns, without a browser. Times are
those of a machine that does nothing else.

    python -m studies turning [SCENE.toml ...] [--presses 40]        (needs playwright and Chromium; by default the scenes below; some minutes)
"""

from __future__ import annotations

import math
import shutil
import statistics
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from studies.command_line import parser_of
from studies.timing import timed
from toolbox import Scene
from toolbox.page import explore

SCENES = Path(__file__).parents[1] / "scenes"
SHOWN = ("jansen_2", "navarro_lopez_4", "popp_rudolph", "brake_laws")
PAUSE = 0.4
"""Seconds between two keys, after the answer: somebody looks, and the map goes on."""

LISTENS = """() => {
  window.pressed = 0; window.waited = []; window.followed = []; window.first = true;
  document.addEventListener("keydown", () => { pressed = performance.now(); first = true; }, true);
  new MutationObserver(() => {
    if (!pressed || document.body.dataset.painted !== String(asked)) return;
    const since = performance.now() - pressed, decided = document.body.dataset.decided === String(asked);
    if (first) waited.push(since); else if (decided) followed.push(since);
    first = false;
    if (decided) pressed = 0;
  }).observe(document.body, { attributes: true, attributeFilter: ["data-painted", "data-decided"] });
}"""


def settle(tab: Any, seconds: float = 120.0) -> None:
    """Wait until all that was turned is answered and painted; asked seldom, so that the page has the processor. Raises TimeoutError."""
    end = time.monotonic() + seconds
    while not tab.evaluate("asked > 0 && answered === asked && !running && document.body.dataset.painted === String(asked)"):
        if time.monotonic() > end:
            raise TimeoutError(f"The page gave no answer within {seconds:g} s.")
        time.sleep(0.1)


def painted(tab: Any, label: str, presses: int) -> tuple[list[float], list[float]]:
    """Milliseconds from each key to the painted answer, and to the verdicts that came after it, under one law."""
    tab.select_option("#law", label)
    settle(tab)
    tab.locator("#numbers input[type=range]:enabled").first.focus()
    tab.keyboard.press("ArrowRight")  # the first may compile
    settle(tab)
    tab.evaluate("() => { waited = []; followed = []; }")
    for k in range(presses):  # up and down again, so that no law finds the slider at its end
        time.sleep(PAUSE)
        tab.keyboard.press("ArrowRight" if 2 * k < presses else "ArrowLeft")
        settle(tab)
    return tab.evaluate("waited"), tab.evaluate("followed")


def served(page: Any, label: str, turns: int) -> float:
    """Milliseconds of processor time of a turn without a browser, the median."""
    look = page._look(label)["controls"]
    name = next(
        name for name, each in look.items() if each.number.overridden is None and each.number.value and math.isfinite(each.number.value)
    )
    spent = []
    for k in range(turns + 1):
        value = look[name].number.value * (1.0 + 1e-4 * (k + 1))
        asked = {"page": "", "setting": {"label": label, "changes": {name: value}, "disturbance": ""}}
        spent.append(1e3 * timed(lambda a=asked: page._answer("run", a))[1])
    return statistics.median(spent[1:])


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a row for each law."""
    from playwright.sync_api import sync_playwright

    parser = parser_of(__doc__)
    parser.add_argument("scenes", nargs="*", type=Path, default=[SCENES / f"{name}.toml" for name in SHOWN], metavar="SCENE.toml")
    parser.add_argument("--presses", type=int, default=40, metavar="N", help="keys for each law (40)")
    given = parser.parse_args(arguments)
    print(f"{'painted after a key, ms':<58}{'median':>8}{'90 %':>8}{'most':>8}{'processor':>12}   verdicts that followed")
    every: list[float] = []
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        for path in given.scenes:
            with explore(Scene.load(path), port=0) as page:
                if page.warming is not None:
                    page.warming.join()
                tab = browser.new_page(viewport={"width": 1300, "height": 900})
                tab.goto(page.address)
                settle(tab)
                tab.evaluate(LISTENS)
                for label in page.loops:
                    times, followed = painted(tab, label, given.presses)
                    every += times
                    if not times:  # the first slider stands at its end
                        print(f"{path.stem + ', ' + label:<58}{'-':>8}", flush=True)
                        continue
                    row = f"{np.median(times):>8.0f}{np.quantile(times, 0.9):>8.0f}{max(times):>8.0f}"
                    later = f"{len(followed):>6}, the last after {max(followed):.0f} ms" if followed else f"{0:>6}"
                    print(f"{path.stem + ', ' + label:<58}{row}{served(page, label, 9):>12.1f}{later}", flush=True)
                tab.close()
        browser.close()
    print(f"{'all':<58}{np.median(every):>8.0f}{np.quantile(every, 0.9):>8.0f}{max(every):>8.0f}")


if __name__ == "__main__":
    main()
