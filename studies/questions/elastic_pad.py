"""When does an elastic pad squeal, what does it do then, and what stops it: damping of its material, or dither of the push?

    python -m studies elastic_pad [FOLDER]            (needs the extra `fe`; default studies/figures)

A pad of 80 mm x 20 mm on springs in two directions at its back, pressed on a disc by five contacts. Friction is constant; two modes of the pad that friction
couples come together and one of them grows (flutter). Steady sliding is linearised for the onset; the cycle beyond it, in which contacts part, stick and
slip one by one, has every event located. A stiff block on the springs of the minimal model of squeal has the onset of its closed form.

Found: damping of the material shrinks the cycle, and lowers the onset before it raises it, because it damps the two modes unequally. Dither of the push
by half of the load takes a tenth to a fifth of the swing at 0.5 to 20 kHz and ends nothing.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from models import Coulomb, ElasticPad, SquealingPad, block_mesh, body_of_mesh
from studies.command_line import figure_folder
from toolbox import Trajectory, compose, plot, simulate
from toolbox.inputs import sine

CONTACTS = 5


def lining(friction: float = 0.5, damping_time: float = 2e-6) -> ElasticPad:
    """The pad: modulus 1 GPa, 2500 kg/m3, mount 1e8 N/m in both directions with 1 % damping, contacts 2e8 N/m in all, at 2 m/s. All numbers are chosen."""
    body = body_of_mesh(
        block_mesh((0.08, 0.02), (CONTACTS - 1, 4)), density=2500.0, modulus=1e9, poisson=0.25, thickness=0.04, damping_time=damping_time
    )
    mount, face = 1e8, body.face_nodes("bottom")
    ports = {f"along.{i}": body.point(node, "x") for i, node in enumerate(face)}
    ports |= {f"into.{i}": -body.point(node, "y") for i, node in enumerate(face)}
    reduced = body.reduced(ports | {"x": body.mean("top", "x"), "y": -body.mean("top", "y")})
    damper = 2 * 0.01 * math.sqrt(mount * 2500.0 * 0.08 * 0.02 * 0.04)
    mounted = reduced.mounted({"x": (mount, damper), "y": (mount, damper)})
    return ElasticPad(
        mounted, (5e-6,) * CONTACTS, contact_stiffness=2e8 / CONTACTS, disc_speed=2.0, friction=Coulomb(friction, friction), force_ports="y"
    )


def stiff_block(modulus: float = 1e13) -> ElasticPad:
    """A block on the inclined springs of `SquealingPad`, scaled by 1e6, its rotation held by far stiffer ones: two modes where the modulus is high."""
    minimal, scale = SquealingPad(damping=0.0), 1e6
    k, a = np.array(minimal.stiffness), np.array(minimal.angle)
    body = body_of_mesh(block_mesh((0.05, 0.02), (2, 1)), density=1000.0, modulus=modulus)
    face = body.face_nodes("bottom")
    ports = {f"along.{i}": body.point(node, "x") for i, node in enumerate(face)} | {
        f"into.{i}": -body.point(node, "y") for i, node in enumerate(face)
    }
    ports |= {"x": body.mean("top", "x"), "y": -body.mean("top", "y"), "turn": body.mean("left", "y") - body.mean("right", "y")}
    reduced = body.reduced(ports)
    x, y, turn = (np.eye(reduced.size)[reduced.index(port)] for port in ("x", "y", "turn"))
    springs = sum(ki * np.outer(cos * x + sin * y, cos * x + sin * y) for ki, cos, sin in zip(k, np.cos(a), np.sin(a), strict=True))
    held = replace(reduced, stiffness=reduced.stiffness + scale * (springs + 1e4 * np.outer(turn, turn)))
    return ElasticPad(held, (1e-5,) * len(face), contact_stiffness=scale * minimal.contact_stiffness / len(face))


def squeal(pad: ElasticPad, duration: float = 0.1, push: Any = None) -> Trajectory:
    """A run from beside steady sliding."""
    start = {"pad.displacement": 1.02 * pad.steady_sliding_displacement()}
    inputs = {} if push is None else {"pad.push": push}
    return simulate(compose(pad), duration, start=start, inputs=inputs, accuracy=1e-5)


def swing(run: Trajectory, last: float = 0.02) -> dict[str, float]:
    """Of the last seconds: swing of the speed of the first contact [m/s], lowest normal force over its mean, shares of time open and stuck (all contacts)."""
    after = run.end - last
    samples = run.at(np.linspace(after, run.end, 4001))
    speed, normal = samples["pad.rate"][:, 0], samples["pad.normal_force"]
    return {
        "swing": float(np.ptp(speed)),
        "lowest load": float(normal.min() / normal.mean()),
        "open": sum(run.time_in(f"touch.{i}", "open", after=after) for i in range(CONTACTS)) / (CONTACTS * last),
        "stuck": sum(run.time_in(f"pad.{i}", "stick", after=after) for i in range(CONTACTS)) / (CONTACTS * last),
    }


def draw(run: Trajectory, shown: float = 1.5e-3) -> Any:
    """A few periods of squeal: what each contact does, and the normal force."""
    import matplotlib.pyplot as plt

    times = np.linspace(run.end - shown, run.end, 1500)
    samples = run.at(times)
    modes = np.array(
        [
            np.where(samples.modes[f"touch.{i}"] == "open", 1.0, np.where(samples.modes[f"pad.{i}"] == "stick", 0.1, 0.7))
            for i in range(CONTACTS)
        ]
    )
    with plt.rc_context(plot.PAPER):
        figure, (face, force) = plt.subplots(2, 1, figsize=(0.75 * plot.WIDTH, 3.4), sharex=True, layout="constrained")
        span = (0.0, 1e3 * shown, -0.5, CONTACTS - 0.5)
        face.imshow(modes, aspect="auto", cmap="gray", vmin=0, vmax=1, extent=span, interpolation="nearest", origin="lower")
        face.set(ylabel="contact", yticks=range(CONTACTS))
        tones = {0.7: "grey: slip", 1.0: "white: open", 0.1: "dark: stick"}
        face.set_title(", ".join(word for tone, word in tones.items() if (modes == tone).any()), loc="left", fontsize=8.5)
        force.plot(1e3 * (times - times[0]), samples["pad.normal_force"], **plot.LINES[0])
        force.set(xlabel="time [ms]", ylabel="normal force [N]", ylim=(0, None))
    return figure


def main() -> None:
    """Print the table and write the figure."""
    folder = figure_folder()
    exact = SquealingPad(damping=0.0).flutter_friction()
    print(f"two-mode limit: flutter from mu = {exact:.4f} by the closed form of the minimal model; a block with a modulus of")
    for modulus in (1e13, 1e11, 1e9, 1e8):
        print(f"  {modulus:7.0e} Pa {stiff_block(modulus).flutter_friction(1.2):8.4f}")
    onset = lining().flutter_friction()
    print(
        f"elastic pad: flutter from mu = {onset:.4f}, at {abs(lining().poles(onset)[0].imag) / 2 / math.pi:.0f} Hz; by the damping of its material:"
    )
    for damping_time in (1e-6, 2e-6, 4e-6, 8e-6, 16e-6):
        print(f"  {1e6 * damping_time:4.0f} us {lining(damping_time=damping_time).flutter_friction():8.4f}")
    words = "swing of a contact [m/s], lowest load / mean, share of time open, stuck"
    print(f"\nCycles: {words}")
    for friction in (0.35, 0.45, 0.5, 0.6):
        run = squeal(lining(friction))
        print(f"  mu {friction:4.2f}        " + "".join(f"{value:10.3f}" for value in swing(run).values()) + f"   {len(run.events)} events")
        if friction == 0.6:
            draw(run).savefig(folder / "elastic_pad.png")
    for damping_time in (4e-6, 8e-6, 16e-6):
        run = squeal(lining(0.5, damping_time))
        print(f"  mu 0.50, {1e6 * damping_time:2.0f} us " + "".join(f"{value:10.3f}" for value in swing(run).values()))
    for frequency in (500.0, 2000.0, 8000.0, 20_000.0):
        run = squeal(lining(0.5), push=sine(0.0, 200.0, frequency))
        print(f"  mu 0.50, push 200 N at {1e-3 * frequency:4.1f} kHz" + "".join(f"{value:10.3f}" for value in swing(run).values()))


if __name__ == "__main__":
    main()
