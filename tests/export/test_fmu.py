"""Laws as FMUs: another simulator loads them and gets the law that was simulated."""

import shutil
import sys
import zipfile
from xml.etree import ElementTree

import numpy as np
import pytest

from controllers import LQG, LinearMPC, SoftTorque, StiffPI
from models import BitRock, wells
from toolbox import SceneError, closed_loop, compose, export_fmu, simulate

PLANT = compose(wells.JANSEN_2, BitRock())
LIMITS = {"lowest_torque": 0.0, "highest_torque": 20_000.0}
PERIOD = 0.01

compiled = pytest.mark.skipif(
    shutil.which("cc") is None or sys.platform != "linux", reason="an FMU is compiled with `cc`, which is not here"
)


def loader():
    """fmpy with its FMI 2.0, or a skip."""
    pytest.importorskip("fmpy.fmi2", reason="the FMU is loaded with fmpy, which is not here")
    import fmpy

    return fmpy


def answers(fmpy, path, period, grid, inputs, parts=1):
    """What an FMU drives at every sample of a grid, given {signal: values on the grid}; each period in so many communication steps."""
    description = fmpy.read_model_description(str(path), validate=True)
    references = {variable.name: variable.valueReference for variable in description.modelVariables}
    unit = fmpy.fmi2.FMU2Slave(
        guid=description.guid, unzipDirectory=fmpy.extract(str(path)), modelIdentifier=description.coSimulation.modelIdentifier
    )
    unit.instantiate()
    unit.setupExperiment(startTime=0.0)
    unit.enterInitializationMode()
    unit.exitInitializationMode()
    found = []
    for k, t in enumerate(grid):
        unit.setReal([references[name] for name in inputs], [float(values[k]) for values in inputs.values()])
        for part in range(parts):
            unit.doStep(t + part * period / parts, period / parts)
        found.append(unit.getReal([references["top.torque"]])[0])
    unit.terminate()
    unit.freeInstance()
    shutil.rmtree(unit.unzipDirectory)
    return np.array(found)


@compiled
@pytest.mark.parametrize("parts", [1, 4])
@pytest.mark.parametrize("law", [SoftTorque(reference=8.0, **LIMITS), LQG(reference=8.0)], ids=["SoftTorque", "LQG"])
def test_a_co_simulation_samples_the_law_as_the_loop_does(tmp_path, law, parts):
    fmpy = loader()
    path = export_fmu(closed_loop(PLANT, law, sample_time=PERIOD), tmp_path / "drive")
    grid = PERIOD * np.arange(1001)
    run = simulate(PLANT, 10.0, controller=law, sample_time=PERIOD, output_times=grid)
    found = answers(fmpy, path, PERIOD, grid[:-1], {"top.speed": run["top.speed"]}, parts)  # the set-point is that of the law
    torque = run["top.torque"][:-1]
    assert np.abs(found - torque).max() <= 1e-12 * np.abs(torque).max()
    assert np.ptp(torque) > 1000.0


@compiled
def test_a_predictive_law_travels_with_its_solver(tmp_path):
    fmpy = loader()
    law = LinearMPC(reference=8.0, torque_rate=20_000.0, **LIMITS)
    path = export_fmu(closed_loop(PLANT, law, sample_time=0.1), tmp_path / "mpc.fmu")
    planned = law.design(PLANT)
    speeds = np.full(10, 7.5)  # a short while: by itself, without the loop, the law is not stable
    found = answers(fmpy, path, 0.1, 0.1 * np.arange(10), {"top.speed": speeds, "top.reference": np.full(10, 8.0)})
    assert found == pytest.approx([planned(0.1 * k, [speed]) for k, speed in enumerate(speeds)], abs=1.0)


@compiled
def test_the_description_names_variables_units_and_start_values(tmp_path):
    path = export_fmu(closed_loop(PLANT, StiffPI(reference=7.25), sample_time=PERIOD), tmp_path / "stiff")
    with zipfile.ZipFile(path) as archive:
        assert {name for name in archive.namelist() if not name.startswith("documentation/")} == {
            "modelDescription.xml",
            "binaries/linux64/stiff.so",
        }
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    variables = {each.get("name"): (each.get("causality"), each.find("Real").attrib) for each in root.find("ModelVariables")}
    assert variables == {
        "top.speed": ("input", {"unit": "rad/s", "start": "0.0"}),
        "top.torque.held": ("input", {"unit": "N m", "start": "0.0"}),
        "top.reference": ("input", {"unit": "rad/s", "start": "7.25"}),
        "top.torque": ("output", {"unit": "N m"}),
        "memory.pi.angle": ("local", {"unit": "rad", "start": "0.0"}),
        "memory.pi.started": ("local", {"unit": "1", "start": "0.0"}),
    }
    assert root.get("fmiVersion") == "2.0" and root.find("CoSimulation").get("modelIdentifier") == "stiff"


def test_without_a_compiler_or_with_one_that_fails_the_error_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr("toolbox.export.fmu.shutil.which", lambda name: None)
    monkeypatch.delenv("CC", raising=False)
    with pytest.raises(SceneError, match="C compiler"):
        export_fmu(closed_loop(PLANT, StiffPI(), sample_time=PERIOD), tmp_path / "stiff")
    if sys.platform in ("linux", "darwin"):
        monkeypatch.setenv("CC", "false")
        with pytest.raises(SceneError, match="`false` failed"):
            export_fmu(closed_loop(PLANT, StiffPI(), sample_time=PERIOD), tmp_path / "stiff")
    assert not list(tmp_path.iterdir())
