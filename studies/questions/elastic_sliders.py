"""Which part of an elastic slider's face sticks, and when does the last of it let go? Two finite-element studies redone, beside their rigid forms.

    python -m studies elastic_sliders [FOLDER]            (needs the extra `fe`; default studies/figures)

A steel cube of 10 mm under 0.1 MPa is dragged by a plate that speeds up evenly, held by a spring and a damper at its back face. Three models:

rigid   the whole face sticks until k a t^2 / 2 + c a t + m a = mu_s N.
rows    eleven rows of the face, each with its load from statics and friction along the pull; every event located (`ElasticSlider`). A row that slips hands
        what it lacks to its neighbours, but all together they carry mu_s N, as the rigid face: the last row lets go with the rigid slider.
nodes   every node of the face may open, and rubs in two directions under its own pressure (`step_contacts`). Spring and damper hold the cube above the face,
        which presses the held edge and lifts the far one, so pressure and with it friction change as the pull grows. The last nodes let go before the
        rigid slider: all slip, some sideways, and only when all slip along the pull does the face carry mu_s N.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from models import (
    Coulomb,
    ElasticBody,
    ElasticFace,
    ElasticSlider,
    Exponential,
    PlateContact,
    ReducedBody,
    Slider,
    block_mesh,
    body_of_mesh,
)
from studies.command_line import figure_folder
from studies.questions.sliders import ACCELERATION, adhesion_time
from toolbox import Trajectory, compose, plot, simulate, time
from toolbox.contacts import ContactProblem, ContactRun, press_contacts, step_contacts
from toolbox.inputs import ramp

SIDE, PRESSURE, MU, STIFFNESS, DAMPING = 0.01, 1e5, 0.35, 1e4, 5e3
"""Side of the cube [m] (assumed: the study states no area), pressure [Pa], static friction, spring [N/m], damper [N s/m]."""
PUBLISHED = {"share at 0.16 s": 0.57, "share at 0.20 s": 0.26, "no node sticks from [s]": 0.2175}
"""What an independent model of 1 mm bricks with the same numbers gave."""


@dataclass(frozen=True)
class Pull:
    """How the cube is pulled: factors on the published load, friction, damper and acceleration of the plate."""

    load: float = 1.0
    friction: float = 1.0
    damping: float = 1.0
    acceleration: float = 1.0

    def rigid_time(self) -> float:
        """When the rigid slider lets go [s]."""
        contact = PlateContact(load=self.load * PRESSURE * SIDE**2, friction=Coulomb(MU * self.friction, MU * self.friction))
        return adhesion_time(Slider(damping=self.damping * DAMPING), contact, self.acceleration * ACCELERATION)


# ------------------------------------------------------------------------------------------------------------------------------------------- models
def cube(divisions: int | tuple[int, int, int] = 10, damping_time: float = 0.0) -> ElasticBody:
    """The steel cube of the studies, in bricks: 7800 kg/m3, 2.1e5 MPa, 0.3."""
    parts = (divisions,) * 3 if isinstance(divisions, int) else divisions
    return body_of_mesh(block_mesh((SIDE,) * 3, parts), density=7800.0, modulus=2.1e11, poisson=0.3, damping_time=damping_time)


def face_body(divisions: int = 10, band: float = 0.0) -> ReducedBody:
    """The cube with every node of its face as a contact, in the modes of a band [Hz]; `face_body().save(...)` made the file of `elastic_face.toml`."""
    body = cube(divisions)
    nodes = body.face_nodes("bottom")
    ports = {f"{axis}.{i}": body.point(node, axis) for axis in "xyz" for i, node in enumerate(nodes)}
    ports |= {"back": body.mean("left", "x"), "top": body.mean("top", "z"), "top.along": body.mean("top", "x")}
    return replace(body.reduced(ports, band), contact_positions=body.nodes[nodes], contact_areas=body.faces["bottom"][nodes])


def face_problem(
    divisions: int = 10, band: float = 0.0, pull: Pull = Pull(), mount: tuple[float, float] = (STIFFNESS, DAMPING)
) -> ContactProblem:
    """The cube on its plate with a contact under every node of its face, in the modes of a band [Hz]."""
    friction = Exponential(static=pull.friction * MU, kinetic=pull.friction * 0.25, decay=1.0)
    return ElasticFace(
        face_body(divisions, band), ("x", "y"), "z", force_ports=("top", "top.along"), support_port="back",
        support_stiffness=mount[0], support_damping=pull.damping * mount[1], friction=friction,
    ).problem()  # fmt: skip


def face_run(problem: ContactProblem, step: float = 1e-3, duration: float = 0.24, pull: Pull = Pull()) -> ContactRun:
    """The plate speeds up under the cube, which has settled under its load first."""
    load = {"top": -pull.load * PRESSURE * SIDE**2}
    plate = {"surface.x": ramp(0.0, 40 * pull.acceleration * ACCELERATION, 0.0, 40.0)}
    return step_contacts(problem, duration, step=step, inputs=load | plate, start=press_contacts(problem, load))


def row_slider() -> ElasticSlider:
    """Eleven rows under loads from statics; `row_slider().body.save(...)` made the file of `studies/scenes/elastic_slider.toml`."""
    body = cube((10, 4, 4), damping_time=1e-6).clamped("bottom", "yz")
    ports = {f"contact.{i}": row for i, row in enumerate(body.node_row_ports("bottom", "x", "x"))} | {"held": body.mean("left", "x")}
    return ElasticSlider(body.reduced(ports), tuple(PRESSURE * body.node_row_areas("bottom", "x")))


def row_run(accuracy: float = 1e-5) -> Trajectory:
    """Eleven rows on the plate that speeds up, with located events."""
    return simulate(
        compose(row_slider()), 0.24, inputs={"plate.speed": ramp(0.0, 4 * ACCELERATION, 0.0, 4.0)}, method="stiff", accuracy=accuracy
    )


def incline_run(divisions: int = 5, angle: float = math.radians(22.0), step: float = 2e-3) -> ContactRun:
    """The cube on an incline that is raised from level to `angle` [rad] in 1 s under a vertical force of 10 N, mu 0.35, without spring and damper."""
    problem = face_problem(divisions, mount=(0.0, 0.0))
    raised = angle * time
    problem = ContactProblem(**{**{word: getattr(problem, word) for word in problem.__dataclass_fields__}, "friction": Coulomb(MU, MU)})
    load = {"top": -10.0 * ca.cos(raised), "top.along": 10.0 * ca.sin(raised)}
    return step_contacts(problem, 1.0, step=step, inputs=load, start=press_contacts(problem, {"top": -10.0}))


# ----------------------------------------------------------------------------------------------------------------------------------------- measures
def full_friction(run: ContactRun, pull: Pull = Pull()) -> float:
    """The first instant [s] at which the face carries all of mu_s N, to 1e-3."""
    drag = np.abs(run.tangential[:, :, 0].sum(axis=1))
    found = np.flatnonzero(drag >= (1 - 1e-3) * pull.friction * MU * run.normal.sum(axis=1))
    return float(run.time[found[0]]) if found.size else math.nan


def measures(run: ContactRun) -> dict[str, float]:
    """Shared area, end of adhesion and critical displacement of the nodes."""

    def at(instant: float) -> float:
        return float(run.share()[np.argmin(np.abs(run.time - instant))])

    last = int(np.argmin(np.abs(run.time - run.last("stick"))))
    return {
        "share at 0.16 s": at(0.16),
        "share at 0.20 s": at(0.20),
        "no node sticks from [s]": float(run.time[min(last + 1, len(run.time) - 1)]),
        "full friction from [s]": full_friction(run),
        "displacement there [mm]": 1e3 * float(run["back"][last]),
        "largest pressure at rest [MPa]": 1e-6 * float(run.pressure[0].max()),
        "largest share open": float(run.share("open").max()),
    }


def first_slips(run: Trajectory) -> np.ndarray:
    """When each row first slips [s], in order of the rows."""
    first = {event.element: event.time for event in reversed(run.events) if event.before == "stick"}
    return np.array([first[f"plate.{i}"] for i in range(len(first))])


def trends(divisions: int = 5) -> list[tuple[str, float, float, float]]:
    """(number, factor, end of adhesion of the nodes, that of the rigid slider) [s] for every number that was varied in the studies."""
    found = []
    for name in ("load", "friction", "damping", "acceleration"):
        for factor in (0.5, 1.0, 2.0):
            pull = Pull(**{name: factor})
            rigid = pull.rigid_time()
            run = face_run(face_problem(divisions, pull=pull), rigid / 200, 1.05 * rigid, pull)
            found.append((name, factor, run.last("stick"), rigid))
    return found


def contradictions() -> list[str]:
    """Numbers that the studies print and that Coulomb's law with their own data does not allow, with the arithmetic."""
    return [
        f"largest tangential stress 0.0381 MPa: where a node slips it is mu p, under the printed peak of 0.1806 MPa {MU} x 0.1806 = {MU * 0.1806:.4f}",
        f"0.1 s of stick beside slip on the incline at 45 deg: F sin 45 = {10 * math.sqrt(0.5):.2f} N against mu F cos 45 = {10 * MU * math.sqrt(0.5):.2f} N; "
        "spring and damper hold nothing at rest, so all of the face slips at once",
        f"tangential 0.113 MPa at a place with a pressure of 0.270 MPa: the bound there is {MU} x 0.270 = {MU * 0.270:.4f} MPa",
        "bands of 80-150 and 1300-1600 Hz: the lowest natural frequency of the free cube is 148 kHz, and on its spring and damper it is overdamped",
    ]


# ----------------------------------------------------------------------------------------------------------------------------------------- pictures
def draw_shares(rows: Trajectory, nodes: ContactRun) -> Any:
    """The share that sticks over time, of rows and of nodes, with the end of the rigid slider's adhesion."""
    import matplotlib.pyplot as plt

    with plt.rc_context(plot.PAPER):
        figure, ax = plt.subplots(figsize=(0.7 * plot.WIDTH, 2.8), layout="constrained")
        times = np.linspace(0, rows.end, 2401)
        ax.plot(times, rows.at(times)["plate.stuck"], label="rows, loads from statics", **plot.LINES[1])
        ax.step(nodes.time, nodes.share(), where="post", label="nodes that may open", **plot.LINES[0])
        ax.axvline(Pull().rigid_time(), color="0.4", linewidth=0.9, linestyle=":", label="rigid slider lets go")
        ax.set(xlabel="time [s]", ylabel="share that sticks [1]", xlim=(0, nodes.end), ylim=(-0.03, 1.03))
        ax.legend(frameon=False, loc="lower left")
    return figure


def draw_faces(run: ContactRun, times: tuple[float, ...] = (0.08, 0.16, 0.20, 0.21)) -> Any:
    """Maps of the face: modes at some instants, and pressure, traction and what friction has taken at the last of them."""
    import matplotlib.pyplot as plt

    with plt.rc_context(plot.PAPER | {"font.size": 8.0}):
        figure, axes = plt.subplots(2, 4, figsize=(plot.WIDTH, 3.1), layout="constrained")
        for ax, instant in zip(axes[0], times, strict=True):
            run.plot_map(instant, "mode", ax)
            ax.get_legend().remove()
            ax.set_title(f"{instant:g} s: {run.share()[np.argmin(np.abs(run.time - instant))]:.0%} stick", fontsize=8)
            ax.set(xlabel="", ylabel="y [mm]" if ax is axes[0, 0] else "")
        for ax, word in zip(axes[1], ("pressure", "traction", "friction_work"), strict=False):
            run.plot_map(times[-1], word, ax)
            ax.set(ylabel="y [mm]" if ax is axes[1, 0] else "")
        axes[1, 3].axis("off")
        handles, labels = [], []
        for ax in axes[0]:
            for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
                if label not in labels:
                    handles.append(handle)
                    labels.append(label)
        axes[1, 3].legend(handles, labels, frameon=False, loc="center", title="the plate pulls\ntowards +x")
    return figure


def main() -> None:
    """Print the tables and write the figures and the animation."""
    folder = figure_folder()
    rows, rigid = row_run(), Pull().rigid_time()
    slips = first_slips(rows)
    print(
        f"rows: first slips at {slips.min():.4f} s, the last at {slips.max():.4f} s; rigid slider {rigid:.4f} s ({slips.max() / rigid - 1:+.1e})"
    )
    nodes = face_run(face_problem(), 5e-4)
    print(f"nodes: {nodes}")
    for word, value in measures(nodes).items():
        expected = f"   (independent model {PUBLISHED[word]:g})" if word in PUBLISHED else ""
        print(f"  {word:32}{value:10.4g}{expected}")
    audit = nodes.audit()
    print("  energy [J]: " + ", ".join(f"{word} {value:.3g}" for word, value in audit.items()))
    incline = incline_run()
    angle, full = 22.0 * incline.last("stick"), 22.0 * full_friction(incline)
    print(
        f"incline: the last node lets go at {angle:.2f} deg, all friction is used at {full:.2f} deg; rigid slider {math.degrees(math.atan(MU)):.2f} deg"
    )
    print("\nEnd of adhesion [s] where one number is halved, kept, doubled: nodes (rigid)\n")
    found = trends()
    for name in dict.fromkeys(row[0] for row in found):
        print(f"{name:16}" + "   ".join(f"{last:.4f} ({exact:.4f})" for word, _, last, exact in found if word == name))
    print("\nPrinted numbers that are no target:\n")
    for line in contradictions():
        print(f"- {line}")
    draw_shares(rows, nodes).savefig(folder / "elastic_shares.png")
    draw_faces(nodes).savefig(folder / "elastic_faces.png")
    nodes.animate(folder / "elastic_slider.gif")


if __name__ == "__main__":
    main()
