"""Films of runs: as long as asked, red while the contact sticks, without anything from elsewhere."""

import re

import pytest
from PIL import Image

from models import BlockOnBelt, FlowLine
from toolbox import SceneError, compose, simulate
from toolbox.figures import film
from toolbox.figures.films import RATE


@pytest.fixture(scope="module")
def run():
    return simulate(compose(BlockOnBelt()), 20.0)


def reds(picture):
    return sum(count for count, (r, g, b) in picture.convert("RGB").getcolors(100_000) if r > 150 and g < 110 and b < 90)


def test_a_film_is_red_while_the_block_sticks_and_lasts_as_long_as_asked(run, tmp_path):
    with Image.open(film(run, tmp_path / "run.gif", seconds=1.0)) as shown:
        assert shown.n_frames == RATE and shown.info["duration"] == 1000 // RATE
        stuck = [(a, b) for a, b, mode in run.intervals("belt") if mode == "stick"]
        for k in (0, 3, 8, 9, 12, 17):
            shown.seek(k)
            at = 20.0 * k / (RATE - 1)
            assert (reds(shown) > 100) == any(a <= at <= b for a, b in stuck), at


def test_a_film_as_a_page_needs_nothing_else(run, tmp_path):
    text = film(run, tmp_path / "run.html", seconds="0.2 s").read_text(encoding="utf-8")
    assert text.count("data:image/png;base64") == 4 and "<button" in text
    assert re.findall(r'(?:src|href)="(https?:[^"]+)"', text) == [] and 'class="fa' not in text


def test_what_cannot_be_filmed_is_refused(run, tmp_path):
    with pytest.raises(SceneError, match="must end with .gif or .html"):
        film(run, tmp_path / "run.mp4")
    with pytest.raises(SceneError, match="nothing to film"):
        film(simulate(compose(FlowLine()), 0.1), tmp_path / "flow.gif")
