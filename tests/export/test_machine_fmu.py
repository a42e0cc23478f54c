"""Machines as FMUs: other simulators step them, or integrate them, and get the switches of `simulate`."""

import ctypes
import shutil
import subprocess
import sys
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from controllers import LinearMPC, StiffPI
from models import BitRock, BlockOnBelt, wells
from studies.benchmarks.machines_in_c import STRICT
from tests.plants import RIG
from toolbox import Component, Equations, Sampled, Scene, SceneError, UnilateralContact, closed_loop, compose, export_fmu, simulate, state
from toolbox.commands.command_line import main

fmpy = pytest.importorskip("fmpy", reason="FMUs are loaded with fmpy, which is not here")
pytestmark = pytest.mark.skipif(
    shutil.which("cc") is None or sys.platform != "linux", reason="an FMU is compiled with `cc`, which is not here"
)
PLAIN = closed_loop(compose(wells.NAVARRO_LOPEZ_4, BitRock(weight=97_347.0)), inputs={"top.torque": 9000.0})
DRIVEN = closed_loop(compose(wells.JANSEN_2, BitRock(weight=97_347.0)), Sampled(StiffPI(reference=4.7), 0.01, delay=0.015))
BELT = closed_loop(compose(BlockOnBelt()))


@dataclass(frozen=True)
class Ball(Component):
    """A ball that falls on a rigid floor."""

    def equations(self, signal):
        x, v = state("ball.height", "m"), state("ball.speed", "m/s")
        floor = UnilateralContact("floor", -x, -v, restitution=0.5)
        return Equations({x: v, v: -10.0 + floor.force / 2.0}, elements=[floor])


VERSIONS = ("2.0", "3.0")


@pytest.fixture(scope="module")
def units(tmp_path_factory):
    """{(loop, version): its FMU}, each written once."""
    folder = tmp_path_factory.mktemp("units")
    loops = {"plain": PLAIN, "driven": DRIVEN, "belt": BELT}
    made = {}

    def unit(name, version="2.0"):
        if (name, version) not in made:
            path = folder / f"{name}{version[0]}.fmu"
            made[name, version] = export_fmu(loops[name], path, part="loop", duration=30.0, version=version)
        return made[name, version]

    return unit


class Instance:
    """An instance of a unit in fmpy, with numbers by name."""

    def __init__(self, path, kind="CoSimulation", **more):
        self.description = fmpy.read_model_description(str(path))
        self.references = {each.name: each.valueReference for each in self.description.modelVariables}
        two = self.description.fmiVersion == "2.0"
        module = fmpy.fmi2 if two else fmpy.fmi3
        self.two, self.folder = two, fmpy.extract(str(path))
        given = {
            "guid": self.description.guid,
            "unzipDirectory": self.folder,
            "modelIdentifier": self.description.coSimulation.modelIdentifier,
        }
        self.unit = getattr(module, f"FMU{2 if two else 3}{'Slave' if kind == 'CoSimulation' else 'Model'}")(**given)
        self.unit.instantiate(**more)

    def begin(self, start=0.0, **numbers):
        if self.two:
            self.unit.setupExperiment(startTime=start)
            self.unit.enterInitializationMode()
        else:
            self.unit.enterInitializationMode(startTime=start)
        self.set(**numbers)
        return self

    def started(self, start=0.0, **numbers):
        self.begin(start, **numbers)
        self.unit.exitInitializationMode()
        return self

    def set(self, **numbers):
        references, values = [self.references[name] for name in numbers], list(numbers.values())
        (self.unit.setReal if self.two else self.unit.setFloat64)(references, values)

    def get(self, *names):
        references = [self.references[name] for name in names]
        found = (self.unit.getReal if self.two else self.unit.getFloat64)(references)
        return found[0] if len(names) == 1 else np.array(found)

    def mode(self, element):
        return (self.unit.getInteger if self.two else self.unit.getInt32)([self.references[f"{element}.mode"]])[0]

    def step(self, t, h):
        return self.unit.doStep(t, h)

    def close(self):
        self.unit.terminate()
        self.unit.freeInstance()
        shutil.rmtree(self.folder)


def changes(found, element):
    """Times and new modes where the mode of an element changes in a record of fmpy."""
    modes = found[f"{element}.mode"]
    places = np.flatnonzero(np.diff(modes)) + 1
    return found["time"][places], modes[places]


def modes_of(run, element):
    """The same of a run."""
    numbers = {"stick": 0, "slip+": 1, "slip-": -1}
    events = [event for event in run.events if event.element == element]
    return np.array([event.time for event in events]), np.array([numbers[event.after] for event in events])


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_a_unit_is_valid_and_switches_as_simulate_does(units, version, kind):
    from fmpy.validation import validate_fmu

    path = units("plain", version)
    assert validate_fmu(str(path)) == []
    run = simulate(PLAIN, 30.0)
    more = {"relative_tolerance": 1e-8, "record_events": True} if kind == "ModelExchange" else {}
    outputs = ["bit.speed", "bit.torque", "bit.mode"]
    found = fmpy.simulate_fmu(str(path), stop_time=30.0, output_interval=0.1, fmi_type=kind, output=outputs, **more)
    times, modes = changes(found, "bit")
    wanted, after = modes_of(run, "bit")
    assert modes.tolist() == after.tolist() and len(after) > 1
    assert np.abs(times - wanted).max() < (0.1 if kind == "CoSimulation" else 1e-4)
    assert found["bit.torque"][-1] == pytest.approx(run.at(30.0)["bit.torque"], rel=1e-4) and abs(found["bit.torque"][-1]) > 100.0


@pytest.mark.parametrize("version", VERSIONS)
def test_outputs_are_right_at_initialisation_at_every_point_and_after_an_input_is_set(units, version):
    grid = np.linspace(0.0, 10.0, 101)
    run = simulate(DRIVEN, 10.0, output_times=grid, accuracy=1e-6)
    unit = Instance(units("driven", version)).begin()
    names = ("top.speed", "bit.speed", "bit.torque", "top.torque")
    found = [unit.get(*names)]
    unit.unit.exitInitializationMode()
    for k in range(100):
        unit.step(grid[k], 0.1)
        found.append(unit.get(*names))
    unit.close()
    for name, values in zip(names, np.transpose(found), strict=True):
        assert values == pytest.approx(run[name], abs=1e-5 * np.abs(run[name]).max())
    unit = Instance(units("plain", version)).started()
    unit.step(0.0, 1.0)
    before = unit.get("der(top.speed)" if "der(top.speed)" in unit.references else "der(chain.speed.0)")
    unit.set(**{"top.torque": 20_000.0})
    after = unit.get("der(top.speed)" if "der(top.speed)" in unit.references else "der(chain.speed.0)")
    assert unit.get("top.torque") == 20_000.0 and after > before + 1.0  # seen before the next step is made
    unit.close()


@pytest.mark.parametrize("period", [1.0, 0.1, 1e-3])
def test_communication_steps_change_no_switch(units, period):
    wanted, after = modes_of(simulate(DRIVEN, 20.0), "bit")
    unit = Instance(units("driven", "3.0"), earlyReturnAllowed=True, eventModeUsed=True).started()
    t, found, target = 0.0, [], 0.0
    for k in range(1, round(20.0 / period) + 1):
        target = k * period
        while t < target:
            events, _, early, last = unit.step(t, target - t)
            assert events == early and (last == target or early)
            if early:
                found.append((last, unit.mode("bit")))
                unit.unit.enterEventMode()
                unit.unit.updateDiscreteStates()
                unit.unit.enterStepMode()
            t = last if early else target
    unit.close()
    assert [mode for _, mode in found] == after.tolist() and len(found) > 3
    assert np.abs([time for time, _ in found] - wanted).max() < 1e-5


@pytest.mark.parametrize("version", VERSIONS)
def test_a_state_is_saved_serialised_and_set(units, version):
    unit = Instance(units("driven", version)).started()
    unit.step(0.0, 5.0)
    get, put = ("getFMUstate", "setFMUstate") if version == "2.0" else ("getFMUState", "setFMUState")
    saved = getattr(unit.unit, get)()
    raw = (unit.unit.serializeFMUstate if version == "2.0" else unit.unit.serializeFMUState)(saved)

    def on():
        unit.step(5.0, 3.0)
        return unit.get("bit.speed", "bit.torque").tolist()

    first = on()
    getattr(unit.unit, put)(saved)
    again = on()
    copy = (unit.unit.deSerializeFMUstate if version == "2.0" else unit.unit.deserializeFMUState)(raw)
    getattr(unit.unit, put)(copy)
    assert first == again == on() and first[0] != 0.0
    unit.close()


def test_variables_have_units_bounds_and_start_values_and_one_name_is_one_variable(units):
    variables = {each.name: each for each in fmpy.read_model_description(str(units("plain"))).modelVariables}
    weight = variables["bit.weight"]
    assert (weight.causality, weight.unit, float(weight.start), float(weight.min)) == ("input", "N", 97_347.0, 0.0)
    assert variables["bit.friction.static"].causality == "parameter" and variables["bit.friction.static"].variability == "tunable"
    assert variables["bit.mode"].description == "-1: slip-, 0: stick, 1: slip+"
    inertias = [name for name in variables if name.startswith("chain.inertia")]
    assert inertias and all(float(variables[name].start) > 0.0 for name in inertias)


def test_numbers_set_before_the_start_hold_from_the_start_and_states_too(units):
    loop = PLAIN.replace(parameters={"bit.friction.static": 0.7}, start={"chain.speed.3": 2.0})
    run = simulate(loop, 10.0)
    unit = Instance(units("plain")).started(**{"bit.friction.static": 0.7, "chain.speed.3": 2.0})
    assert unit.get("chain.speed.3") == 2.0
    unit.step(0.0, 10.0)
    assert unit.get("bit.speed") == pytest.approx(run.at(10.0)["bit.speed"], abs=1e-4)
    unit.close()


def test_the_clock_of_the_importer_may_begin_anywhere(units):
    first, later = Instance(units("driven")).started(), Instance(units("driven")).started(100.0)
    first.step(0.0, 7.0)
    later.step(100.0, 7.0)
    assert later.get("bit.speed") == first.get("bit.speed") != 0.0
    first.close()
    later.close()


def test_law_and_plant_as_two_units_are_the_loop(tmp_path):
    plant, law, period = compose(wells.JANSEN_2, BitRock(weight=97_347.0)), StiffPI(reference=8.0), 0.01
    grid = period * np.arange(1001)
    machine = export_fmu(plant, tmp_path / "machine.fmu", duration=10.0, accuracy=1e-12)
    drive = export_fmu(closed_loop(plant, law, sample_time=period), tmp_path / "drive.fmu")
    for delay in (0.0, period):
        run = simulate(closed_loop(plant, Sampled(law, period, delay=delay)), 10.0, accuracy=1e-12, output_times=grid)
        plants, laws = Instance(machine).started(), Instance(drive).begin()
        laws.unit.exitInitializationMode()
        found, given = [plants.get("bit.speed")], 0.0
        for t in grid[:-1]:
            held = given
            laws.set(**{"top.speed": plants.get("top.speed"), "top.torque.held": held})
            laws.step(t, period)
            given = laws.get("top.torque")
            plants.set(**{"top.torque": given if delay == 0.0 else held})  # the law first; or both at once
            plants.step(t, period)
            found.append(plants.get("bit.speed"))
        assert np.abs(np.array(found) - run["bit.speed"]).max() < 1e-10 * np.abs(run["bit.speed"]).max()
        plants.close()
        laws.close()


def test_a_mutated_number_is_refused_and_told(units):
    unit = Instance(units("plain")).started()
    refused = [("bit.speed", 1.0), ("top.torque", float("nan")), ("bit.torque", 1.0), ("bit.friction.static", -0.1), ("top.torque", np.inf)]
    for name, value in refused:
        with pytest.raises(Exception, match="fmi2SetReal"):
            unit.set(**{name: value})
    unit.step(0.0, 1.0)
    before = unit.get("bit.speed", "top.speed")
    for t, step in ((-1.0, 0.5), (0.5, 0.1), (1.0, float("nan")), (1.0, np.inf)):
        with pytest.raises(Exception, match="fmi2DoStep"):
            unit.step(t, step)
    assert (unit.get("bit.speed", "top.speed") == before).all()  # it has not moved
    unit.step(1.0, 1.0)
    unit.close()


def test_a_second_instance_and_a_second_run_after_an_early_end_are_as_the_first(units):
    first, second = Instance(units("driven")).started(), Instance(units("driven")).started()
    found = []
    for k in range(400):
        first.step(0.01 * k, 0.01)
        if k < 150:
            second.step(0.01 * k, 0.01)
        found.append(first.get("top.speed"))
    second.unit.terminate()
    with pytest.raises(Exception, match="fmi2DoStep"):
        second.step(1.5, 0.01)
    second.unit.reset()
    second.started()
    for k in range(400):
        second.step(0.01 * k, 0.01)
        assert second.get("top.speed") == found[k]
    assert len(set(found)) > 10
    first.close()
    second.close()


@pytest.mark.parametrize("version", VERSIONS)
def test_the_sources_compile_without_a_warning_and_licence_and_resources_go_along(tmp_path, version):
    scene = Path("studies/scenes/block_on_belt.toml")
    path = export_fmu(BELT, tmp_path / "belt.fmu", duration=10.0, version=version, resources=[scene])
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path / "unit")
    assert (tmp_path / "unit" / "resources" / scene.name).read_bytes() == scene.read_bytes()
    assert "BSD 3-Clause" in (tmp_path / "unit" / "documentation" / "licenses" / "stickslip-toolbox.txt").read_text()
    assert (tmp_path / "unit" / "sources" / "buildDescription.xml").exists() == (version == "3.0")
    (source,) = (tmp_path / "unit" / "sources").glob("*.c")  # whoever compiles all of them meets nothing twice
    for compiler in filter(None, map(shutil.which, ("gcc", "clang"))):
        subprocess.run([compiler, *STRICT, "-c", str(source), "-o", str(tmp_path / "object.o")], check=True)


@pytest.mark.parametrize("name", ["u", "double"])
def test_a_unit_may_have_the_name_of_a_word_of_c(tmp_path, name):
    found = fmpy.simulate_fmu(
        str(export_fmu(BELT, tmp_path / f"{name}.fmu", duration=10.0)), stop_time=10.0, output=["belt.mode"], record_events=True
    )
    assert changes(found, "belt")[1].tolist() == modes_of(simulate(BELT, 10.0), "belt")[1].tolist()


def test_what_cannot_go_is_refused_by_name(tmp_path):
    with pytest.raises(SceneError, match="solves a program at every sample"):
        export_fmu(closed_loop(RIG, LinearMPC(reference=8.0), sample_time=0.1), tmp_path / "rig.fmu", part="loop", duration=5.0)
    with pytest.raises(SceneError, match='`version` must be "2.0" or "3.0"'):
        export_fmu(BELT, tmp_path / "belt.fmu", duration=5.0, version="1.0")
    with pytest.raises(SceneError, match='belong to `part="loop"`'):
        export_fmu(closed_loop(RIG, StiffPI(), sample_time=0.01), tmp_path / "law.fmu", version="3.0")
    with pytest.raises(SceneError, match="`duration` must be given"):
        export_fmu(BELT, tmp_path / "belt.fmu")
    assert not list(tmp_path.iterdir())


def test_friction_in_two_directions_goes_by_co_simulation_only(tmp_path):
    scene = Scene.load("studies/scenes/hoisting.toml")
    loop = scene[scene.cases[0].label]
    path = export_fmu(loop, tmp_path / "string.fmu", part="loop")
    description = fmpy.read_model_description(str(path), validate=True)
    assert description.modelExchange is None and description.coSimulation is not None
    with pytest.raises(Exception, match="nstantiate"):
        Instance(path, "ModelExchange")
    run = simulate(loop, loop.duration, method="explicit")
    unit = Instance(path).started()
    unit.step(0.0, loop.duration)
    names = [each.name for each in description.modelVariables if each.causality == "output" and not each.name.endswith(".mode")]
    for name in [name for name in names if name in run.names][:4]:
        assert unit.get(name) == pytest.approx(run.at(loop.duration)[name], abs=1e-5)
    unit.close()


def test_the_command_writes_a_machine_as_a_unit(tmp_path, capsys):
    call = ["export", "studies/scenes/jansen_2.toml", "--controller", "softer PI, 100 Hz", "--to", "fmu", "--out", str(tmp_path / "out")]
    assert main([*call, "--duration", "5 s", "--version", "3.0"]) == 0 and "loop as fmu" in capsys.readouterr().out
    with zipfile.ZipFile(tmp_path / "out" / "jansen_2.fmu") as archive:
        assert {"resources/jansen_2.toml", "binaries/x86_64-linux/jansen_2.so"} <= set(archive.namelist())
    assert main([*call, "--part", "law", "--name", "drive"]) == 0 and (tmp_path / "out" / "drive.fmu").exists()
    assert main([*call, "--part", "law", "--version", "3.0"]) == 2


@pytest.mark.parametrize("version", VERSIONS)
def test_a_bouncing_ball_comes_to_rest_on_the_floor_of_an_importer_that_integrates(tmp_path, version):
    loop = closed_loop(compose(Ball()), start={"ball.height": 1.0})
    path, run = export_fmu(loop, tmp_path / "ball.fmu", part="loop", duration=3.0, version=version), simulate(loop, 3.0)
    found = fmpy.simulate_fmu(
        str(path), stop_time=3.0, output_interval=0.01, fmi_type="ModelExchange", output=["ball.height", "floor.mode"], relative_tolerance=1e-8,
        record_events=True,
    )  # fmt: skip
    grid = np.linspace(0.0, 3.0, 31)
    height = np.interp(grid, found["time"], found["ball.height"])
    assert np.abs(height - run.at(grid)["ball.height"]).max() < 1e-6
    assert found["ball.height"].min() > -1e-9 and found["floor.mode"][-1] == 0 and abs(found["ball.height"][-1]) < 1e-9


@pytest.mark.parametrize("version", VERSIONS)
def test_directional_derivatives_are_those_of_differences(units, version):
    unit = Instance(units("plain", version), "ModelExchange")
    unit.started()
    unit.unit.enterContinuousTimeMode()
    rates = [name for name in unit.references if name.startswith("der(")]
    states = [name[4:-1] for name in rates]
    size, draw = unit.description.numberOfContinuousStates, np.random.default_rng(1)
    assert len(states) == size
    begin, direction = draw.uniform(0.5, 2.0, size), draw.normal(size=size)

    def slopes(values):
        values, found = np.ascontiguousarray(values), np.empty(size)
        kind = ctypes.POINTER(fmpy.fmi2.fmi2Real if unit.two else fmpy.fmi3.fmi3Float64)
        unit.unit.setContinuousStates(values.ctypes.data_as(kind), size)
        (unit.unit.getDerivatives if unit.two else unit.unit.getContinuousStateDerivatives)(found.ctypes.data_as(kind), size)
        return found

    step = 1e-6
    wanted = (slopes(begin + step * direction) - slopes(begin - step * direction)) / (2 * step)
    slopes(begin)
    unknown, known = [unit.references[name] for name in rates], [unit.references[name] for name in states]
    found = unit.unit.getDirectionalDerivative(unknown, known, list(direction))
    np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-7 * np.abs(wanted).max())
    unit.close()


def test_an_importer_that_integrates_sees_inputs_in_time_that_are_inside_of_the_machine(tmp_path):
    scene = Scene.load("studies/scenes/den_hartog.toml")
    loop = scene[scene.labels[0]]
    run = simulate(loop, 60.0)
    path = export_fmu(loop, tmp_path / "oscillator.fmu", part="loop", duration=60.0)
    found = fmpy.simulate_fmu(
        str(path), stop_time=60.0, output_interval=0.1, fmi_type="ModelExchange", output=["belt.mode", "belt.force"], relative_tolerance=1e-8,
        record_events=True,
    )  # fmt: skip
    times, modes = changes(found, "belt")
    wanted, after = modes_of(run, "belt")
    assert modes.tolist() == after.tolist() and len(after) > 20 and np.abs(times - wanted).max() < 1e-5
    assert np.isfinite(found["belt.force"]).all()


@pytest.mark.parametrize("name", ["slider_on_incline", "disk_stack"])
def test_an_input_and_a_parameter_of_one_name_are_one_variable(tmp_path, name):
    scene = Scene.load(f"studies/scenes/{name}.toml")
    path = export_fmu(scene[scene.labels[0]], tmp_path / f"{name}.fmu", part="loop")
    names = [each.name for each in fmpy.read_model_description(str(path), validate=True).modelVariables]
    assert len(set(names)) == len(names)
