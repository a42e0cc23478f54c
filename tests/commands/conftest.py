"""What tests of commands share."""

import pytest

BELT = 'title = "belt"\nduration = 40\n[[plant]]\npart = "BlockOnBelt"\n[[controllers]]\nlabel = "one"\n[[controllers]]\nlabel = "two"\n'
"""A scene of two equal runs that take no time."""


@pytest.fixture
def belt(request, tmp_path):
    """The file of that scene, or of the scene `BELT` of the module."""
    path = tmp_path / "belt.toml"
    path.write_text(getattr(request.module, "BELT", BELT))
    return path
