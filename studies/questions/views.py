"""What do the responses, the modes and the spectrum of one rig show? The figures of the pages on analysis, robustness and the page to explore.

Two inertias of Jansen and van den Steen under 97.3 kN: frequency response of soft torque at 90 rpm, stability over both gains of a PI at 38 rpm, the
describing function of the bit under soft torque at 40 rpm, stick-slip under a stiff PI at 60 rpm as a spectrogram and as a film; and of the inclined
string of Aarsnes and Shor, off bottom, its well, torque and drag, and modes.

    python -m studies views [--out FOLDER] [--page]        (half a minute; --page: also the page in Chromium, by playwright)
"""

from __future__ import annotations

import shutil
import time
from pathlib import Path
from typing import Any

import matplotlib

import models
from controllers import PI, SoftTorque, StiffPI
from models import BitRock, TorqueDrag, read_survey, torque_drag, wells
from studies.command_line import parser_of
from toolbox import Scene, closed_loop, compose, limit_cycle, simulate, use_units
from toolbox.figures import film, spectrogram
from toolbox.robustness import (
    DescribingFunction,
    FrequencyResponse,
    StabilityChart,
    describing_function,
    frequency_response,
    stability_chart,
)
from toolbox.simulation.trajectory import Trajectory
from toolbox.steady_states import ModeShapes, mode_shapes

FOLDER = Path(__file__).parents[1] / "figures"
SCENES = Path(__file__).parents[1] / "scenes"
TABLES = Path(models.__file__).parent / "tables"
RIG = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
RANGES: dict[str, Any] = {"pi.proportional": (0.0, 3000.0), "pi.integral": (0.0, 1500.0)}


def response() -> FrequencyResponse:
    """Of soft torque at 90 rpm."""
    return frequency_response(closed_loop(RIG, SoftTorque(reference="90 rpm")))


def chart() -> StabilityChart:
    """Over both gains of a PI at 38 rpm."""
    return stability_chart(closed_loop(RIG, PI(proportional=1000.0, integral=500.0, reference="38 rpm")), RANGES)


def describing() -> DescribingFunction:
    """Of soft torque at 40 rpm, beside its stick-slip."""
    loop = closed_loop(RIG, SoftTorque(reference="40 rpm"))
    return describing_function(loop, limit_cycle(loop, 200.0))


def modes() -> ModeShapes:
    """Of the inclined string, under the PI that was published, which holds its top nearly fast."""
    return mode_shapes(Scene.load(SCENES / "aarsnes_shor.toml")["published PI"])


def drags() -> dict[str, TorqueDrag]:
    """Of that string in its well, with the friction coefficient of its authors: pulled, lowered, and wound up by half of what turns all of it."""
    tables = [TABLES / f"aarsnes_shor_{name}.csv" for name in ("sections", "survey")]
    turned = torque_drag(*tables, 0.3, turning_speed=1.0)
    return {
        "pulled": torque_drag(*tables, 0.3, axial_speed=-1.0),
        "lowered": torque_drag(*tables, 0.3, axial_speed=1.0),
        "turned": turned,
        "wound up, half torque": torque_drag(*tables, 0.3, turning_speed=1.0, load_at_top=0.5 * float(turned.torque[0])),
    }


def stick_slip() -> Trajectory:
    """Under a stiff PI at 60 rpm."""
    return simulate(closed_loop(RIG, StiffPI(reference="60 rpm")), 120.0)


def photograph(path: Path) -> None:
    """The page of Jansen's rig under soft torque, in stick-slip, as a browser shows it."""
    from playwright.sync_api import sync_playwright

    from toolbox.page import explore

    with explore(Scene.load(SCENES / "jansen_2.toml"), port=0) as page, sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        tab = browser.new_page(viewport={"width": 1280, "height": 980})
        tab.goto(page.address)
        tab.select_option("#law", "stiff PI")
        end = time.monotonic() + 60.0
        while not tab.evaluate("Boolean(map && map.last)") and time.monotonic() < end:
            time.sleep(0.1)
        tab.screenshot(path=path)
        browser.close()


def main() -> None:
    """Write the figures."""
    parser = parser_of(__doc__)
    parser.add_argument("--out", type=Path, default=FOLDER, help="folder of the figures")
    parser.add_argument("--page", action="store_true", help="also the page in a browser")
    asked = parser.parse_args()
    matplotlib.use("Agg")
    asked.out.mkdir(parents=True, exist_ok=True)
    with use_units("metric"):
        found = response()
        found.bode()[0].figure.savefig(asked.out / "bode.png")
        found.nichols().figure.savefig(asked.out / "nichols.png")
        chart().plot().figure.savefig(asked.out / "stability_chart.png")
        describing().plot()[0].figure.savefig(asked.out / "describing_function.png")
        axes = None
        for label, found in drags().items():
            axes = found.plot(label, axes)
        axes[0].figure.savefig(asked.out / "torque_drag.png")
        read_survey(TABLES / "aarsnes_shor_survey.csv").plot()[0].figure.savefig(asked.out / "well_path.png")
        modes().plot().figure.savefig(asked.out / "mode_shapes.png")
        run = stick_slip()
        spectrogram(run).figure.savefig(asked.out / "spectrogram.png")
        film(run, asked.out / "film.gif", seconds=4.0)
    if asked.page:
        photograph(asked.out / "explore.png")
    print(asked.out)


if __name__ == "__main__":
    main()
