"""The pytest plugin: a fixture with assertions on runs, and a marker that repeats a test on perturbed machines.

    @pytest.mark.stickslip_perturbed({"bit.weight": 0.2, "chain.stiffness": 0.1})
    def test_my_drive_frees_the_bit(stickslip_checks, perturbed):
        run = simulate(rig, 200.0, controller=MyDrive(), parameters=perturbed(rig))
        stickslip_checks.no_stick_slip(run, after=100.0)

    def test_my_drive_is_robust(stickslip_checks):
        law = Sampled(MyDrive(), 0.01, delay=0.03)
        stickslip_checks.robust(rig, law, disk_margin=0.35)
        stickslip_checks.survives(rig, law, 200.0, errors={"chain.inertia.0": (0.8, 1.2)}, starts=cycle_phases(stick_slip, 8))

The assertions are those of `toolbox.robustness.checks.Checks`; a failed one saves a figure under `--stickslip-figures DIR`, or the test's `tmp_path`.

Why a module of its own, beside the packages: pytest imports its plugins at every start, and importing anything below `toolbox` imports casadi. Here
everything heavy is imported by the fixtures, when a test asks for them.
"""

from __future__ import annotations

from pathlib import Path

import pytest

MARKER = "stickslip_perturbed"


def pytest_addoption(parser):
    """The option `--stickslip-figures`."""
    group = parser.getgroup("stickslip", "stick-slip")
    group.addoption(
        "--stickslip-figures", metavar="DIR", default=None, help="folder for the figures of failed checks (the test's tmp_path without)"
    )


def pytest_configure(config):
    """Register the marker."""
    text = "repeat the test with each parameter of the plant raised and lowered by its part of the nominal value, through the fixture `perturbed`"
    config.addinivalue_line("markers", f"{MARKER}(parts): {text}")


def pytest_generate_tests(metafunc):
    """One test per perturbation, and one for the nominal plant."""
    if "perturbed" not in metafunc.fixturenames:
        return
    marker = metafunc.definition.get_closest_marker(MARKER)
    parts = marker.args[0] if marker is not None and len(marker.args) == 1 and not marker.kwargs else None
    if not isinstance(parts, dict) or not all(
        isinstance(name, str) and isinstance(part, (int, float)) and part > 0 for name, part in parts.items()
    ):
        raise pytest.UsageError(
            f'The fixture `perturbed` needs the marker `{MARKER}({{"bit.weight": 0.2}})` with parts > 0 by parameter, on {metafunc.definition.nodeid}.'
        )
    cases = [{}, *({name: sign * part} for name, part in parts.items() for sign in (1, -1))]
    words = [", ".join(f"{name} {100 * part:+g} %" for name, part in case.items()) or "nominal" for case in cases]
    metafunc.parametrize("perturbed", cases, ids=words, indirect=True)


@pytest.fixture
def perturbed(request):
    """Function of a plant -> {parameter: perturbed value}, to be given to `simulate(..., parameters=perturbed(plant))`."""
    from toolbox.robustness.checks import Perturbation

    return Perturbation(getattr(request, "param", {}))


@pytest.fixture
def stickslip_checks(request):
    """Assertions on runs, see `toolbox.robustness.checks.Checks`."""
    from toolbox.robustness.checks import Checks

    folder = request.config.getoption("stickslip_figures", None)
    return Checks(folder=Path(folder) if folder else request.getfixturevalue("tmp_path"), name=request.node.name)


@pytest.fixture
def stickslip():
    """The former name of the fixture: an argument `stickslip` of a test would hide what `import stickslip` gives."""
    pytest.fail("The fixture `stickslip` is now `stickslip_checks`.", pytrace=False)
