"""Exported C of machines of every kind compiles without a warning under each compiler that is here."""

import itertools
import shutil
import subprocess
from dataclasses import dataclass

import pytest

from controllers import PI, IdealSlidingMode, StiffPI, ZTorque
from models import Block, BlockOnBelt, Coulomb, LuGre
from tests.plants import RIG
from toolbox import Component, DryFriction, Equations, Sampled, Scene, UnilateralContact, closed_loop, compose, export_c, state
from toolbox.export.machine_c import machine, machine_sources
from toolbox.export.machine_fmu import Unit

COMPILERS = list(filter(None, map(shutil.which, ("gcc", "clang"))))
STRICT = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic"]
HOISTING = Scene.load("studies/scenes/hoisting.toml")


@dataclass(frozen=True)
class Decay(Component):
    """x' = -x: no element, no input, no parameter."""

    def equations(self, signal):
        x = state("decay.level", "m")
        return Equations(flow={x: -x})


@dataclass(frozen=True)
class Ball(Component):
    """A ball that falls on a floor and rubs along it."""

    def equations(self, signal):
        y, v, x, w = state("ball.height", "m"), state("ball.rise", "m/s"), state("ball.way", "m"), state("ball.speed", "m/s")
        floor = UnilateralContact("floor", -y, -v, restitution=0.5)
        rub = DryFriction("rub", w, Coulomb(static=0.4, kinetic=0.3), floor.force)
        return Equations(flow={y: v, v: -9.81 + floor.force, x: w, w: 0.5 + rub.force}, elements=[floor, rub])


LOOPS = {
    "no element, input or parameter": closed_loop(compose(Decay()), start={"decay.level": 1.0}),
    "no element": closed_loop(compose(Block())),
    "a memory only": closed_loop(compose(BlockOnBelt(friction=LuGre()))),
    "no controller": closed_loop(RIG, inputs={"top.torque": 8e3}),
    "a continuous controller": closed_loop(RIG, StiffPI()),
    "a sampled controller": closed_loop(RIG, PI(lowest_torque=0.0, highest_torque=2e4), sample_time=0.01),
    "a delay, noise, and a rate of the torque": closed_loop(
        RIG, Sampled(ZTorque(torque_rate=1e5), 0.01, delay=0.025, noise={"top.speed": 0.01})
    ),
    "friction in two directions": HOISTING[HOISTING.cases[0].label],
    "impacts": closed_loop(compose(Ball()), start={"ball.height": 1.0}),
    "a relay": closed_loop(RIG, IdealSlidingMode()),
}


@pytest.mark.skipif(not COMPILERS, reason="neither gcc nor clang is here")
@pytest.mark.parametrize("kind", LOOPS)
def test_machines_of_every_kind_compile_without_a_warning(tmp_path, kind):
    source, _ = export_c(LOOPS[kind], tmp_path / "made", part="loop", duration=1.0)
    for compiler, file in itertools.product(COMPILERS, (source, source.with_name("main.c"))):
        subprocess.run([compiler, *STRICT, "-O1", "-c", str(file), "-o", str(tmp_path / "made.o")], check=True)
    for version in ("2.0", "3.0"):
        unit = Unit(machine(LOOPS[kind], "made", 1.0), version)
        for name, text in (machine_sources(unit.made, importer=True) | {"made_fmi.c": unit.source("guid")}).items():
            (tmp_path / name).write_text(text)
        for compiler in COMPILERS:
            subprocess.run([compiler, *STRICT, "-fsyntax-only", str(tmp_path / "made_fmi.c")], check=True)
