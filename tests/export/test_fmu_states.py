"""States of FMUs and numbers that are given to them: what is damaged, or wrong, is an error that changes nothing."""

import shutil
import sys
import zipfile

import fmpy
import numpy as np
import pytest

from controllers import PI
from models import BitRock, BlockOnBelt, wells
from tests.export.test_machine_c import Overflowing, overflow
from tests.export.test_machine_fmu import VERSIONS, Instance
from toolbox import SceneError, closed_loop, compose, export_fmu, simulate
from toolbox.export import fmu_archive
from toolbox.export.fmu_archive import folder_here

pytestmark = pytest.mark.skipif(
    shutil.which("cc") is None or sys.platform != "linux", reason="an FMU is compiled with `cc`, which is not here"
)
LOOP = closed_loop(compose(wells.JANSEN_2, BitRock(weight=97_347.0)), PI(lowest_torque=0.0, highest_torque=2e4), sample_time=0.01)


@pytest.fixture(scope="module")
def units(tmp_path_factory):
    """{version: the FMU of the loop}."""
    folder = tmp_path_factory.mktemp("units")
    return {version: export_fmu(LOOP, folder / f"rig{version[0]}.fmu", part="loop", duration=5.0, version=version) for version in VERSIONS}


def state_functions(instance):
    """(get, set, to bytes, from bytes) of an instance."""
    words = (
        ("getFMUstate", "setFMUstate", "serializeFMUstate", "deSerializeFMUstate")
        if instance.two
        else ("getFMUState", "setFMUState", "serializeFMUState", "deserializeFMUState")
    )
    return [getattr(instance.unit, word) for word in words]


def flipped(raw, bits):
    damaged = bytearray(raw)
    for bit in bits:
        damaged[bit // 8] ^= 1 << (bit % 8)
    return bytes(damaged)


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("flips", [1, 2, 3])
def test_a_state_with_flipped_bits_is_an_error_and_the_unit_goes_on(units, version, flips):
    unit = Instance(units[version]).started()
    unit.step(0.0, 1.0)
    get, put, to_bytes, from_bytes = state_functions(unit)
    raw = to_bytes(get())
    random = np.random.default_rng([flips, int(version[0])])
    drawn = [random.choice(8 * len(raw), flips, replace=False) for _ in range(300)]
    drawn += [
        [8 * i + 7 for i in range(7, 8 * flips, 8)],
        [8 * (len(raw) - 8 * (i + 1)) + 63 for i in range(flips)],
    ]  # highest bits of neighbours
    for bits in drawn:
        with pytest.raises(Exception, match="erialize"):
            from_bytes(flipped(raw, bits))
    for other in (raw[:-8], raw + bytes(8), b"", bytes(len(raw))):
        with pytest.raises(Exception, match="erialize"):
            from_bytes(other)
    before = unit.get("bit.speed", "top.torque", "time").tolist() if not unit.two else unit.get("bit.speed", "top.torque").tolist()
    unit.step(1.0, 1.0)
    put(from_bytes(raw))
    again = unit.get("bit.speed", "top.torque", "time").tolist() if not unit.two else unit.get("bit.speed", "top.torque").tolist()
    assert before == again
    unit.close()


@pytest.mark.parametrize("version", VERSIONS)
def test_a_state_of_another_unit_or_another_kind_of_instance_is_refused(units, version, tmp_path):
    unit = Instance(units[version]).started()
    raw = state_functions(unit)[2](state_functions(unit)[0]())
    other = Instance(
        export_fmu(LOOP.replace(inputs={"bit.weight": 5e4}), tmp_path / "other.fmu", part="loop", duration=1.0, version=version)
    ).started()
    with pytest.raises(Exception, match="erialize"):
        state_functions(other)[3](raw)
    exchange = Instance(units[version], "ModelExchange").started()
    with pytest.raises(Exception, match="FMUst|FMUSt"):
        state_functions(exchange)[1](state_functions(exchange)[3](raw))
    for each in (unit, other, exchange):
        each.close()


@pytest.mark.parametrize("version", VERSIONS)
def test_a_step_at_a_wrong_time_is_refused_and_the_unit_has_not_moved(units, version):
    unit = Instance(units[version]).started(start=3.0)
    unit.step(3.0, 0.1)
    before = unit.get("bit.speed", "top.torque").tolist()
    for t in (3.0, 3.2, 0.1, 3.1 + 1e-6, np.nan, np.inf):
        with pytest.raises(Exception, match="DoStep"):
            unit.step(t, 0.1)
    assert unit.get("bit.speed", "top.torque").tolist() == before
    unit.step(sum([0.01] * 310), 0.1)  # the sums of importers end some last bits beside it
    unit.close()


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize(
    "numbers",
    [
        {"pi.proportional": 0.0},
        {"pi.proportional": np.nan},
        {"pi.integral": np.inf},
        {"pi.integral": -1.0},
        {"bit.weight": -1.0},
        {"pi.highest_torque": -5.0},
        {"pi.lowest_torque": 3e4},
        {"bit.friction.kinetic": 0.9},
        {"bit.weight": 5e4, "pi.lowest_torque": 2e4},
    ],
    ids=str,
)
def test_numbers_that_python_refuses_are_refused_and_none_of_the_call_is_set(units, version, numbers):
    parameters = {name: value for name, value in numbers.items() if name != "bit.weight"}
    with pytest.raises(SceneError):
        simulate(LOOP.replace(parameters=parameters, inputs={name: value for name, value in numbers.items() if name == "bit.weight"}), 0.0)
    unit = Instance(units[version]).begin()
    names = ("bit.weight", "pi.proportional", "pi.integral", "pi.lowest_torque", "pi.highest_torque", "bit.friction.kinetic")
    before = unit.get(*names).tolist()
    for _ in range(2):  # before the first step, and behind it
        with pytest.raises(Exception, match="SetReal|SetFloat64"):
            unit.set(**numbers)
        assert unit.get(*names).tolist() == before
        if _ == 0:
            unit.unit.exitInitializationMode()
            unit.step(0.0, 0.1)
    unit.set(**{"pi.lowest_torque": 25e3, "pi.highest_torque": 30e3})  # each alone would contradict the other
    unit.step(0.1, 0.1)
    unit.close()


@pytest.mark.parametrize(
    ("system", "processor", "two", "three"),
    [
        ("linux", "x86_64", "linux64", "x86_64-linux"),
        ("linux", "aarch64", None, "aarch64-linux"),
        ("darwin", "x86_64", "darwin64", "x86_64-darwin"),
        ("darwin", "arm64", None, "aarch64-darwin"),
        ("linux", "riscv64", None, None),
    ],
)
def test_the_binary_lies_where_fmi_looks_for_this_processor_or_is_refused(monkeypatch, tmp_path, system, processor, two, three):
    monkeypatch.setattr(fmu_archive.platform, "machine", lambda: processor)
    monkeypatch.setattr(fmu_archive.sys, "platform", system)
    for version, folder in (("2.0", two), ("3.0", three)):
        if folder is not None:
            assert folder_here(version) == folder
        else:
            with pytest.raises(SceneError, match=rf"FMI {version} has no folder .* {processor}: "):
                folder_here(version)


def test_an_fmu_that_is_made_on_arm_has_its_binary_in_the_folder_of_arm(monkeypatch, tmp_path):
    monkeypatch.setattr(fmu_archive.platform, "machine", lambda: "aarch64")
    path = export_fmu(LOOP, tmp_path / "rig.fmu", part="loop", duration=0.1, version="3.0")
    with zipfile.ZipFile(path) as archive:
        assert [name for name in archive.namelist() if name.endswith(".so")] == ["binaries/aarch64-linux/rig.so"]
    with pytest.raises(SceneError, match=r'FMI 2.0 has no folder .* aarch64: write a loop with `version="3.0"`'):
        export_fmu(LOOP, tmp_path / "law.fmu")
    assert fmpy.read_model_description(str(path)).fmiVersion == "3.0"


@pytest.mark.parametrize("version", VERSIONS)
def test_a_controller_that_gives_no_finite_number_is_an_error_with_its_name(tmp_path, capfd, version):
    loop = closed_loop(compose(BlockOnBelt()), Overflowing(), sample_time=0.01)
    path = export_fmu(loop, tmp_path / "belt.fmu", part="loop", duration=1.0, version=version)
    last = overflow(1e10) * 0.01
    unit = Instance(path).started(**{"overflowing.growth": 1e10})
    unit.step(0.0, last - 0.005)
    with pytest.raises(Exception, match="DoStep"):
        unit.step(last - 0.005, 1.0)
    unit.close()
    stepped = capfd.readouterr()
    with pytest.raises(Exception, match="NewDiscreteStates|UpdateDiscreteStates|EnterEventMode"):
        fmpy.simulate_fmu(str(path), stop_time=1.0, fmi_type="ModelExchange", start_values={"overflowing.growth": 1e10})
    for told in (stepped, capfd.readouterr()):
        assert f"`block.force of Overflowing` at t = {last:.9g} s" in told.out + told.err
