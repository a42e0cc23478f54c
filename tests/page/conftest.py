"""What tests of the page share: a scene, and the page that shows it."""

from pathlib import Path

import pytest

from toolbox import Scene
from toolbox.page import explore

SCENES = Path(__file__).parents[2] / "studies" / "scenes"


@pytest.fixture(scope="module")
def scene():
    return Scene.load(SCENES / "jansen_2.toml")


@pytest.fixture(scope="module")
def page(scene):
    served = explore(scene, port=0)
    yield served
    served.close()
