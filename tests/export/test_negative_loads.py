"""A load that an input makes negative is told by every machine that goes out, with its contact and the time; so are states that are no numbers."""

import ctypes
import shutil
import sys
from dataclasses import dataclass

import numpy as np
import pytest

from models.friction import Coulomb
from studies.benchmarks.machines_in_c import COMPILER, CompiledMachine
from toolbox import Component, DryFriction, Equations, SimulationError, closed_loop, compose, export_c, export_fmu, simulate, state, stepper

NEGATIVE_BOUND = 8
with_compiler = pytest.mark.skipif(COMPILER is None or sys.platform != "linux", reason="a machine is compiled with `cc`, which is not here")


@dataclass(frozen=True)
class Pressed(Component):
    """A block on a belt, pressed by its weight and an actuator; a second block may lean on it, pressed by the friction of the first."""

    leaning: bool = False

    def equations(self, signal):
        x, v = state("block.position", "m"), state("block.speed", "m/s")
        pad = signal("pad.force", "N", default=0.0)
        belt = DryFriction("belt", v - 0.2, Coulomb(1.0, 0.6), 1.0 + pad if not self.leaning else 1.0)
        flow, elements = {x: v, v: belt.force - x}, [belt]
        if self.leaning:
            y, w = state("wedge.position", "m"), state("wedge.speed", "m/s")
            wedge = DryFriction("wedge", w - 0.2, Coulomb(1.0, 0.6), 2.0 + pad + 1.5 * belt.force)
            flow |= {y: w, w: wedge.force - y}
            elements.append(wedge)
        return Equations(flow, elements=elements)


PLAIN, LEANING = closed_loop(compose(Pressed())), closed_loop(compose(Pressed(leaning=True)))


@pytest.mark.parametrize("when", [0.0, 0.5, 3.0])  # at the start, in stick, in slip
def test_a_step_refuses_it_as_simulate_does(when):
    table = ([0.0, when, when, 10.0], [0.0, 0.0, -3.0, -3.0]) if when else -3.0
    with pytest.raises(SimulationError, match=rf"bound of `belt` must be >= 0, but it is -2 at t = {when:g} s"):
        simulate(PLAIN.replace(inputs={"pad.force": table}), 10.0)
    machine = stepper(PLAIN, 0.1, inputs="pad.force", outputs="block.speed", duration=10.0)
    machine.reset()
    while machine.time < when - 1e-9:
        machine.step(0.0)
    with pytest.raises(SimulationError, match=rf"from t = {when:g} s: the bound of `belt` is negative"):
        machine.step(-3.0)
    machine.reset()
    assert np.isfinite(machine.step(0.0)).all()  # and is whole after a reset


def test_a_load_of_zero_is_none():
    machine = stepper(PLAIN, 0.1, inputs="pad.force", outputs="block.speed", duration=10.0)
    for force in (-1.0, 0.0, -1.0, -1.0):
        machine.step(force)


def test_an_environment_refuses_it():
    pytest.importorskip("gymnasium", reason="an environment needs gymnasium, which is not here")
    from toolbox.export.environment import environment
    from toolbox.export.vector_environment import vector_environment

    given = {"actions": {"pad.force": (-5.0, 5.0)}, "observations": {"block.speed": (-5.0, 5.0)}}
    alone = environment(PLAIN, 0.1, 10.0, reward=lambda signals, events: 0.0, **given)
    alone.reset(seed=1)
    alone.step([0.0])
    with pytest.raises(SimulationError, match=r"from t = 0.1 s: the bound of `belt` is negative"):
        alone.step([-3.0])
    together = vector_environment(PLAIN, 3, 0.1, 10.0, reward=lambda signals, switches: 0.0 * switches, **given)
    together.reset(seed=1)
    together.step(np.zeros((3, 1)))
    with pytest.raises(SimulationError, match=r"Copy 1 cannot be stepped on from t = 0.1 s: the bound of `belt` is negative"):
        together.step([[0.0], [-3.0], [0.0]])


def test_a_load_that_the_force_of_another_friction_makes_negative_is_told_where_it_does():
    with pytest.raises(SimulationError, match="bound of `wedge` must be >= 0, but it is -0.2485"):  # where the belt sticks
        simulate(LEANING.replace(inputs={"pad.force": -2.3}), 10.0)
    assert simulate(LEANING, 10.0).end == 10.0
    machine = stepper(LEANING, 0.1, inputs="pad.force", duration=10.0)
    with pytest.raises(SimulationError, match="the bound of `wedge` is negative"):
        for _ in range(100):
            machine.step(-2.3)
    machine.reset()
    for _ in range(100):
        machine.step(0.0)


@with_compiler
def test_a_machine_in_c_returns_its_code_and_the_contact(tmp_path):
    found = CompiledMachine(export_c(LEANING, tmp_path / "wedge", duration=10.0)[0])
    assert found.set("INPUT", "pad.force", -2.3) == 0
    status, k = 0, 0
    while status == 0 and k < 100:
        k += 1
        status = found.step(0.1 * k)
    assert status == NEGATIVE_BOUND and found._function("culprit", ctypes.c_int)(found.memory) == found.number("ELEMENT", "wedge")
    found = CompiledMachine(export_c(PLAIN, tmp_path / "belt", duration=10.0)[0])
    found.run(3.0)
    found.set("INPUT", "pad.force", -3.0)
    assert found.step(3.0) == NEGATIVE_BOUND and found._function("culprit", ctypes.c_int)(found.memory) == 0


# ------------------------------------------------------------------------------------------------------------------------------------- FMUs
VERSIONS = ("2.0", "3.0")


@pytest.fixture(scope="module")
def units(tmp_path_factory):
    """{version: a unit of the block}."""
    pytest.importorskip("fmpy", reason="FMUs are loaded with fmpy, which is not here")
    if shutil.which("cc") is None or sys.platform != "linux":
        pytest.skip("an FMU is compiled with `cc`, which is not here")
    folder = tmp_path_factory.mktemp("units")
    return {version: export_fmu(PLAIN, folder / f"u{version[0]}.fmu", part="loop", duration=10.0, version=version) for version in VERSIONS}


class Importer:
    """A unit in FMPy, which prints what the unit logs, in step mode or in continuous-time mode."""

    def __init__(self, path, exchange):
        import fmpy

        self.description = fmpy.read_model_description(str(path))
        self.references = {each.name: each.valueReference for each in self.description.modelVariables}
        self.two, self.folder = self.description.fmiVersion == "2.0", fmpy.extract(str(path))
        module = fmpy.fmi2 if self.two else fmpy.fmi3
        kind = getattr(module, f"FMU{2 if self.two else 3}{'Model' if exchange else 'Slave'}")
        identifier = (self.description.modelExchange if exchange else self.description.coSimulation).modelIdentifier
        self.unit = kind(guid=self.description.guid, unzipDirectory=self.folder, modelIdentifier=identifier)
        self.unit.instantiate()
        if self.two:
            self.unit.setupExperiment(startTime=0.0)
        self.unit.enterInitializationMode(**({} if self.two else {"startTime": 0.0}))
        self.unit.exitInitializationMode()
        if exchange:
            self.events()
            self.unit.enterContinuousTimeMode()

    def events(self):
        """Event mode at the present point until nothing is left to do."""
        again = True
        while again:
            again = (self.unit.newDiscreteStates if self.two else self.unit.updateDiscreteStates)()[0]

    def press(self, force):
        (self.unit.setReal if self.two else self.unit.setFloat64)([self.references["pad.force"]], [force])

    def go(self, time, *states):
        import fmpy

        self.unit.setTime(time)
        values = np.array(states)
        kind = ctypes.POINTER(fmpy.fmi2.fmi2Real if self.two else fmpy.fmi3.fmi3Float64)
        self.unit.setContinuousStates(values.ctypes.data_as(kind), len(values))

    def close(self):
        self.unit.freeInstance()
        shutil.rmtree(self.folder)


@pytest.fixture
def importer(units):
    """Instances of the unit, given back at the end."""
    made = []

    def make(version, exchange):
        made.append(Importer(units[version], exchange))
        return made[-1]

    yield make
    for each in made:
        each.close()


@pytest.mark.parametrize("version", VERSIONS)
def test_a_unit_that_steps_itself_logs_the_contact_and_the_time(importer, capsys, version):
    found = importer(version, False)
    found.unit.doStep(0.0, 0.5)
    found.press(-3.0)
    with pytest.raises(Exception, match="oStep"):
        found.unit.doStep(0.5, 0.1)
    assert "[ERROR] `belt` at t = 0.5 s: the bound of a friction is negative" in capsys.readouterr().out


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("way", ["in event mode", "on the way"])
def test_a_unit_for_model_exchange_does_so_in_event_mode_and_after_a_step(importer, capsys, version, way):
    found = importer(version, True)
    found.go(0.5, 0.1, 0.2)
    found.unit.completedIntegratorStep()
    if way == "in event mode":
        found.unit.enterEventMode()
        found.press(-3.0)
        with pytest.raises(Exception, match="iscreteStates"):
            found.events()
    else:
        found.press(-3.0)
        with pytest.raises(Exception, match="ompletedIntegratorStep"):
            found.unit.completedIntegratorStep()
    assert "[ERROR] `belt` at t = 0.5 s: the bound of a friction is negative" in capsys.readouterr().out


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_states_and_times_that_are_no_numbers_are_refused_and_change_nothing(importer, capsys, version, wrong):
    found = importer(version, True)
    found.go(0.5, 0.1, 0.2)
    with pytest.raises(Exception, match="etContinuousStates"):
        found.go(0.6, 0.3, wrong)
    assert f"[DISCARD] `block.speed` is {wrong:g} at t = 0.6 s" in capsys.readouterr().out
    read = found.unit.getReal if found.two else found.unit.getFloat64
    assert list(read([found.references[name] for name in ("block.position", "block.speed")])) == [0.1, 0.2]
    with pytest.raises(Exception, match="etTime"):
        found.go(wrong, 0.1, 0.2)
