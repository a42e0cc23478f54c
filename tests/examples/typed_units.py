"""A script of a user who types units everywhere: it runs, and mypy has nothing to say about it."""

from controllers import PI, SoftTorque, StiffPI
from models import BitRock, BlockOnBelt, TorsionalChain, wells
from toolbox import (
    Budget,
    Sampled,
    closed_loop,
    compose,
    equilibrium,
    follow,
    hopf_curve,
    hopf_points,
    impedance,
    limit_cycle,
    linearise,
    measure,
    onset,
    severity_map,
    simulate,
    sweep,
    tune,
    worst_case,
)
from toolbox.inputs import ramp
from toolbox.robustness import performance_limit
from toolbox.simulation import EventExact
from toolbox.steady_states import pole_locus

law = SoftTorque(reference="95 rpm", highest_torque="20 kN m")
speed: float = law.reference
limit: float | None = law.highest_torque
chain = TorsionalChain(inertia=("2122 kg m2", 374.0), stiffness=["473 N m/rad"], top_drag="425 N m s/rad")
first: float = chain.inertia[0] * 2.0
rig = compose(wells.JANSEN_2, BitRock(weight="97.347 kN"))
stiff = StiffPI(reference="80 rpm")

weight = ([0.0, "5 s"], ["97 kN", 98e3])
run = simulate(
    rig,
    "0.2 min",
    start={"top.speed": "20 rpm"},
    inputs={"top.torque": "10 kN m", "bit.weight": weight},
    method=EventExact(budget=Budget(seconds="1 min")),
)
stuck: float = run.time_in("bit", "stick", after="2 s", until="10 s")
speed_then: float = run.at("9.5 s")["bit.speed"]
swing: float = measure.severity(run, "bit.speed", after="5 s")
late: float = measure.settling(run, "top.speed", "20 rpm", size="10 rpm") if stuck > 1e9 else 0.0
sampled = Sampled(PI(reference="60 rpm"), "10 ms", delay="30 ms", noise={"top.speed": "0.1 rpm"}, resolution={"top.speed": "1 rpm"})
simulate(rig, "5 s", controller=sampled, inputs={"top.reference": ramp("35 rpm", "60 rpm", "1 s", 4.0)})

point = equilibrium(closed_loop(rig, inputs={"top.torque": "20 kN m"}))
linearise(closed_loop(rig, inputs={"top.torque": "20 kN m"}))
pole_locus(closed_loop(rig, stiff), "top.reference", ["60 rpm", 8.0])
hopf_points(closed_loop(rig, stiff), "top.reference", ("20 rpm", "130 rpm"), num_values=5)
hopf_curve(closed_loop(rig, stiff), "top.reference", ("20 rpm", "130 rpm"), "bit.weight", ["97 kN", 98e3])
performance_limit(rig, {"top.speed": "90 rpm"}, period="10 ms", delay="5 ms")
impedance(stiff, frequency=[1.0], speed="60 rpm", inertia="2 t m2")

found = onset(
    closed_loop(rig, stiff).at("top.reference", "120 rpm"),
    "top.reference",
    ("60 rpm", "140 rpm"),
    duration="20 s",
    tolerance="10 rpm",
    num_values=3,
)
charted = severity_map(
    closed_loop(rig, stiff),
    {"top.reference": ("60 rpm", "140 rpm"), "bit.weight": ("50 kN", 110e3)},
    duration="10 s",
    shape=(2, 2),
    halvings=0,
)
swept = sweep(closed_loop(rig, stiff, sample_time="10 ms"), {"bit.weight": ["50 kN", 60e3]}, "5 s")
listed = sweep(closed_loop(rig, stiff), [{"bit.weight": "50 kN", "top.reference": "60 rpm"}], "5 s")
tuned = tune(rig, PI(reference="90 rpm"), "severity", {"pi.proportional": ("1 kN m s/rad", 6000.0)}, duration="5 s", runs=10)
judged = worst_case(closed_loop(rig, stiff, reference="80 rpm"), "10 s", after="5 s")
cycle = limit_cycle(compose(BlockOnBelt()), "1 min")
branch = follow(cycle, "block.belt_speed", ("0.1 m/s", "300 mm/s"), points=2, start_towards="0.1 m/s")
