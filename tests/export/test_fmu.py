"""Laws as FMUs: another simulator loads them and gets the law that was simulated."""

import shutil
import subprocess
import sys
import zipfile
from xml.etree import ElementTree

import numpy as np
import pytest

from controllers import LQG, LinearMPC, SoftTorque, StiffPI
from tests.plants import RIG
from toolbox import SceneError, closed_loop, export_fmu, simulate

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
    path = export_fmu(closed_loop(RIG, law, sample_time=PERIOD), tmp_path / "drive")
    grid = PERIOD * np.arange(1001)
    run = simulate(RIG, 10.0, controller=law, sample_time=PERIOD, output_times=grid)
    found = answers(fmpy, path, PERIOD, grid[:-1], {"top.speed": run["top.speed"]}, parts)  # the set-point is that of the law
    torque = run["top.torque"][:-1]
    assert np.abs(found - torque).max() <= 1e-12 * np.abs(torque).max()
    assert np.ptp(torque) > 1000.0


@compiled
def test_a_predictive_law_travels_with_its_solver(tmp_path):
    fmpy = loader()
    law = LinearMPC(reference=8.0, torque_rate=20_000.0, **LIMITS)
    path = export_fmu(closed_loop(RIG, law, sample_time=0.1), tmp_path / "mpc.fmu")
    planned = law.design(RIG)
    speeds = np.full(10, 7.5)  # a short while: by itself, without the loop, the law is not stable
    found = answers(fmpy, path, 0.1, 0.1 * np.arange(10), {"top.speed": speeds, "top.reference": np.full(10, 8.0)})
    assert found == pytest.approx([planned(0.1 * k, [speed]) for k, speed in enumerate(speeds)], abs=1.0)


@compiled
def test_the_description_names_variables_units_and_start_values(tmp_path):
    path = export_fmu(closed_loop(RIG, StiffPI(reference=7.25), sample_time=PERIOD), tmp_path / "stiff")
    with zipfile.ZipFile(path) as archive:
        sources = {"stiff.c", "stiff.h", "stiff_fmi.c"}
        needed = {
            "modelDescription.xml",
            "binaries/linux64/stiff.so",
            "documentation/licenses/stickslip-toolbox.txt",
            *(f"sources/{name}" for name in sources),
        }
        assert set(archive.namelist()) - {"binaries/win64/stiff.dll"} == needed  # that for Windows is there where its compiler is
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    variables = {each.get("name"): (each.get("causality"), each.find("Real").attrib) for each in root.find("ModelVariables")}
    assert variables == {
        "top.speed": ("input", {"unit": "rad/s", "start": "0.0"}),
        "top.torque.held": ("input", {"unit": "N m", "start": "0.0"}),
        "top.reference": ("input", {"unit": "rad/s", "start": "7.25"}),
        "top.torque": ("output", {"unit": "N m"}),
        "memory.stiffpi.angle": ("local", {"unit": "rad", "start": "0.0"}),
        "memory.stiffpi.started": ("local", {"unit": "1", "start": "0.0"}),
        **{
            name: ("parameter", {"unit": unit, "start": repr(value)})
            for name, unit, value in (
                ("law.proportional", "N m s/rad", StiffPI().proportional),
                ("law.integral", "N m/rad", StiffPI().integral),
            )
        },
    }
    assert {each.get("name") for each in root.iter("File")} == {"stiff.c", "stiff_fmi.c"}
    assert float(root.find("DefaultExperiment").get("stepSize")) == PERIOD
    assert root.get("fmiVersion") == "2.0" and root.find("CoSimulation").get("modelIdentifier") == "stiff"


def test_without_a_compiler_or_with_one_that_fails_the_error_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr("toolbox.export.fmu_archive.shutil.which", lambda name: None)
    monkeypatch.delenv("CC", raising=False)
    with pytest.raises(SceneError, match="C compiler"):
        export_fmu(closed_loop(RIG, StiffPI(), sample_time=PERIOD), tmp_path / "stiff")
    if sys.platform in ("linux", "darwin"):
        monkeypatch.setenv("CC", "false")
        with pytest.raises(SceneError, match="`false` failed"):
            export_fmu(closed_loop(RIG, StiffPI(), sample_time=PERIOD), tmp_path / "stiff")
    assert not list(tmp_path.iterdir())


@compiled
def test_the_sources_of_a_unit_compile_without_a_warning(tmp_path):
    path = export_fmu(closed_loop(RIG, SoftTorque(reference=8.0, **LIMITS), sample_time=PERIOD), tmp_path / "drive")
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path / "unit")
    for source in (tmp_path / "unit" / "sources").glob("*.c"):
        strict = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2"]
        subprocess.run(["cc", *strict, "-c", str(source), "-o", str(tmp_path / "object.o")], check=True)


@compiled
def test_outputs_are_right_after_initialisation_gains_can_be_set_and_what_is_not_allowed_is_told(tmp_path):
    fmpy = loader()
    law = SoftTorque(reference=8.0)
    path = export_fmu(closed_loop(RIG, law, sample_time=PERIOD), tmp_path / "drive")
    description = fmpy.read_model_description(str(path), validate=True)
    references = {variable.name: variable.valueReference for variable in description.modelVariables}
    told = []
    folder = fmpy.extract(str(path))
    callbacks = fmpy.fmi2.fmi2CallbackFunctions()
    callbacks.logger = fmpy.fmi2.fmi2CallbackLoggerTYPE(lambda env, name, status, category, message: told.append(message.decode()))
    callbacks.allocateMemory = fmpy.fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.fmi2.calloc)
    callbacks.freeMemory = fmpy.fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.fmi2.free)
    kind = {"unzipDirectory": folder, "modelIdentifier": description.coSimulation.modelIdentifier}
    unit = fmpy.fmi2.FMU2Slave(guid=description.guid, **kind)
    unit.instantiate(callbacks=callbacks)
    with pytest.raises(Exception, match="fmi2DoStep"):
        unit.doStep(0.0, PERIOD)
    unit.setupExperiment(startTime=0.0)
    unit.enterInitializationMode()
    unit.setReal([references["top.speed"]], [5.0])
    unit.exitInitializationMode()
    drive = unit.getReal([references["top.torque"]])[0]
    first = simulate(RIG, PERIOD, controller=law, sample_time=PERIOD, start={"top.speed": 5.0})["top.torque"][0]
    assert drive == pytest.approx(first, rel=1e-12) and abs(drive) > 100.0
    before = unit.getReal([references["law.proportional"]])[0]
    unit.setReal([references["law.proportional"]], [2.0 * before])
    unit.doStep(0.0, PERIOD)  # P e + I e T
    gains = [unit.getReal([references[f"law.{name}"]])[0] for name in ("proportional", "integral")]
    assert gains[0] == 2.0 * before and unit.getReal([references["top.torque"]])[0] - drive == pytest.approx(before * 3.0, rel=1e-9)
    with pytest.raises(Exception, match="fmi2SetReal"):
        unit.setReal([references["top.torque"]], [1.0])
    with pytest.raises(Exception, match="fmi2SetReal"):
        unit.setReal([references["memory.softtorque.angle"]], [1.0])
    unit.terminate()
    other = fmpy.fmi2.FMU2Slave(guid="{another}", **kind)
    with pytest.raises(Exception, match="nstantiate"):
        other.instantiate(callbacks=callbacks)
    words = ("fmi2DoStep must follow", "must not write an output", "memory of the law", "GUID is not that of this unit")
    assert len(told) == len(words) and all(word in message for word, message in zip(words, told, strict=True))
    unit.freeInstance()
    shutil.rmtree(folder)
