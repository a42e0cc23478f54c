"""Lumped flow lines against the closed forms of their elements, waves of the discrete line, and the gel that has to break."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from models import Coulomb, FlowLine, OutletRCR
from models.flow_line import expansion_loss, nozzle_loss, poiseuille_resistance
from toolbox import SceneError, closed_loop, compose, energy_audit, equilibrium, linearise, simulate

LENGTH, BORE, DENSITY, BULK = 2500.0, 0.123, 1500.0, 1.5e9
MUD = {"viscosity": 0.03, "density": DENSITY, "bulk_modulus": BULK}
AREA = math.pi * BORE**2 / 4


def test_a_step_of_flow_into_the_outlet_gives_the_known_pressure():
    # p = Q [R_p + R_d (1 - exp(-t / (R_d C)))]
    rcr, q = OutletRCR(proximal=2e6, distal=3e7, compliance=4e-8), 0.02
    run = simulate(compose(rcr), 5.0, inputs={"line.outlet_flow": q}, accuracy=1e-11)
    t = np.linspace(0.0, 5.0, 50)
    expected = q * (2e6 + 3e7 * (1 - np.exp(-t / (3e7 * 4e-8))))
    np.testing.assert_allclose(run.at(t)["line.outlet_pressure"], expected, rtol=1e-9)
    assert energy_audit(run).relative < 1e-12


def test_steady_flow_needs_the_pressure_of_poiseuille_and_of_the_nozzles():
    q, k = 0.03, nozzle_loss(DENSITY, 4e-4)
    line = FlowLine.pipe(LENGTH, BORE, segments=5, end_loss=k, **MUD)
    rest = equilibrium(closed_loop(compose(line), inputs={"line.inlet_flow": q}))
    viscous = 128 * 0.03 * LENGTH / (math.pi * BORE**4) * q
    assert rest["line.inlet_pressure"] == pytest.approx(viscous + DENSITY / 2 * (q / (0.95 * 4e-4)) ** 2, rel=1e-10)
    back = equilibrium(closed_loop(compose(line), inputs={"line.inlet_flow": -q}))
    assert back["line.inlet_pressure"] == pytest.approx(-rest["line.inlet_pressure"], rel=1e-10)


def test_poiseuille_resistance_is_that_of_the_parabola_of_speeds():
    # Q = int 2 pi r v dr with v = (dp / 4 mu l) (a^2 - r^2)
    radius = BORE / 2
    r = np.linspace(0, radius, 20_001)
    flow = np.trapezoid(2 * math.pi * r * (radius**2 - r**2) / (4 * 0.03 * LENGTH), r)
    assert poiseuille_resistance(LENGTH, BORE, 0.03) == pytest.approx(1 / flow, rel=1e-7)


def test_the_loss_of_an_expansion_is_bernoulli_less_the_momentum_that_the_wall_gives_back():
    # p2 - p1 = rho Q^2 / A2 (1/A1 - 1/A2) by momentum; the loss is what Bernoulli would have given beyond it
    a1, a2, rho, q = 2e-3, 5e-3, 1200.0, 0.01
    ideal = rho / 2 * ((q / a1) ** 2 - (q / a2) ** 2)
    assert expansion_loss(rho, a1, a2) * q**2 == pytest.approx(ideal - rho * q**2 / a2 * (1 / a1 - 1 / a2), rel=1e-12)
    assert expansion_loss(rho, a1, a1) == 0.0


@pytest.mark.parametrize("n", [1, 4, 16])
def test_a_lossless_line_rings_at_the_frequencies_of_its_lumps(n):
    # closed at the pump, open at the end: w_j = 2 / sqrt(L C) sin((2 j - 1) pi / (2 (2 n + 1)))
    line = dataclasses.replace(FlowLine.pipe(LENGTH, BORE, segments=n, **MUD), resistance=(0.0,) * n)
    found = np.sort(np.linalg.eigvals(linearise(compose(line), inputs="line.inlet_flow").A).imag)[n:]
    time = LENGTH / n * math.sqrt(DENSITY / BULK)  # of a wave through one segment, sqrt(L C)
    np.testing.assert_allclose(found, 2 / time * np.sin((2 * np.arange(1, n + 1) - 1) * math.pi / (2 * (2 * n + 1))), rtol=1e-9)


def test_pressure_waves_travel_at_the_speed_of_sound_of_fluid_and_wall():
    # quarter wave: w_1 = (pi / 2) c / length, c = sqrt(bulk modulus / density); half a lump is missing at the end, so the error halves with the lumps
    wave = math.pi / 2 * math.sqrt(BULK / DENSITY) / LENGTH
    error = []
    for n in (10, 20, 40):
        line = dataclasses.replace(FlowLine.pipe(LENGTH, BORE, segments=n, **MUD), resistance=(0.0,) * n)
        poles = np.linalg.eigvals(linearise(compose(line), inputs="line.inlet_flow").A)
        error.append(1 - min(abs(poles)) / wave)
    assert error[2] < 0.013
    assert error[0] / error[1] == pytest.approx(2.0, rel=0.05) and error[1] / error[2] == pytest.approx(2.0, rel=0.05)


def test_every_joule_that_the_pump_puts_in_is_accounted_for_with_and_without_losses():
    line = FlowLine.pipe(LENGTH, BORE, segments=4, end_loss=nozzle_loss(DENSITY, 4e-4), gel=Coulomb(static=20.0, kinetic=8.0), **MUD)
    run = simulate(
        compose(line, OutletRCR()), 30.0, inputs={"line.inlet_flow": ((0.0, 5.0, 20.0, 25.0), (0.0, 0.03, 0.03, 0.0))}, accuracy=1e-9
    )
    audit = energy_audit(run)
    assert audit.relative < 1e-9
    assert all(value >= 0 for value in audit.losses.values())
    free = dataclasses.replace(FlowLine.pipe(LENGTH, BORE, segments=4, **MUD), resistance=(0.0,) * 4)
    ringing = simulate(compose(free), 30.0, start={"line.pressure": 1e5}, accuracy=1e-10)
    stored = energy_audit(ringing).stored["line"]
    assert stored[1] == pytest.approx(stored[0], rel=1e-8)


def test_gelled_mud_stands_until_the_pump_reaches_the_pressure_of_the_gel():
    # slow pump, equal strength at rest and in flow: circulation breaks at 4 tau length / bore
    line = FlowLine.pipe(LENGTH, BORE, segments=5, gel=Coulomb(static=10.0, kinetic=10.0), **MUD)
    strength = 4 * 10.0 * LENGTH / BORE
    run = simulate(compose(line), 100.0, inputs={"line.inlet_flow": 2e-4})
    first = {}
    for event in run.events:
        first.setdefault(event.element, event.time)
    assert list(first) == [f"line.{i}" for i in range(5)]
    releases = list(first.values())
    # beyond the gel, the pump feels no more than the wave impedance sqrt(L / C) and the viscosity of what flows already
    beyond = 2e-4 * (math.sqrt(line.inertance[0] / line.compliance[0]) + sum(line.resistance))
    assert strength < run.at(releases[4])["line.inlet_pressure"] < strength + beyond
    assert beyond < 0.04 * strength
    # before the first segment lets go nothing moves: p = Q t / C, until the load of one segment
    assert releases[0] == pytest.approx(line.compliance[0] * strength / 5 / 2e-4, rel=1e-6)
    assert np.all(run["line.outlet_flow"][run.time < releases[4]] == 0.0)
    # without gel the outlet runs at once
    thin = simulate(compose(FlowLine.pipe(LENGTH, BORE, segments=5, **MUD)), 5.0, inputs={"line.inlet_flow": 2e-4})
    assert thin.at(5.0)["line.outlet_flow"] > 0


def test_a_line_has_no_more_states_and_contacts_than_its_segments_ask_for():
    line = FlowLine.pipe(LENGTH, BORE, segments=3, **MUD)
    plant = compose(line)
    assert plant.x.numel() == 6 and not plant.elements
    assert compose(line, OutletRCR()).x.numel() == 7
    gelled = FlowLine.pipe(LENGTH, BORE, segments=3, gel=Coulomb(), **MUD)
    assert [element.name for element in compose(gelled).elements] == ["line.0", "line.1", "line.2"]


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"resistance": ()}, "resistance"),
        ({"loss": (0.0, 0.0)}, "loss"),
        ({"gel": Coulomb()}, "gel_pressure"),
        ({"gel_pressure": (1.0,)}, "gel"),
    ],
)
def test_a_line_that_cannot_be_built_is_refused_by_name(change, word):
    with pytest.raises(SceneError, match=word):
        compose(FlowLine(**change))


@pytest.mark.parametrize(
    "change",
    [
        {"length": 0.0},
        {"diameter": -1.0},
        {"viscosity": math.nan},
        {"density": 0.0},
        {"bulk_modulus": 0.0},
        {"segments": 0},
        {"segments": 2.0},
    ],
)
def test_a_pipe_of_impossible_size_is_refused_by_name(change):
    with pytest.raises(SceneError, match=next(iter(change))):
        FlowLine.pipe(**({"length": LENGTH, "diameter": BORE, "segments": 2} | MUD | change))


def test_areas_and_coefficients_of_no_nozzle_are_refused_by_name():
    with pytest.raises(SceneError, match="wide"):
        expansion_loss(1000.0, 2e-3, 1e-3)
    with pytest.raises(SceneError, match="area"):
        nozzle_loss(1000.0, 0.0)
