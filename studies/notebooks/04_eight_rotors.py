# %% [markdown]
# # Eight rotors to standstill
#
# **Question.** A brake of eight rotors between nine stators has sixteen rubbing faces. How do they come to rest?
#
# **Theory.** Each face sticks or slips on its own; a slip lasts as long as the key of a rotor swings, half of its period and nearly always
# the same. A stick lasts until the wheel, slower every time, has wound the key up again: $t_{stick} \approx \Delta T/(k\,\Omega)$ grows
# without bound as $\Omega \to 0$. The model is a reconstruction after Larsson and Farhang, of whose paper only the abstract is known here:
# slip durations about constant, stick durations growing almost exponentially until the final stick.

# %%
import matplotlib.pyplot as plt
import numpy as np

from models import DiskStack
from studies.questions.disk_stack import draw_stack, phases, stack_stop
from toolbox import measure, plot

run = stack_stop()
begin, rest = phases(run)["stick-slip"]
print(f"stick-slip from {begin:.3f} s to {rest:.3f} s; {len(run.events)} switches")
cycles = {i: measure.cycles(run, f"stack.{i}", after=begin, until=rest) for i in range(16)}
growth, ends, slips = [], [], []
for i, found in cycles.items():
    n = max(1, len(found) // 5)
    slip, stick = (1e3 * np.array([getattr(cycle, what) for cycle in found]) for what in ("slip", "stick"))
    early, late = np.median(stick[:n]), np.median(stick[-n:])
    growth.append(late / early)
    ends.append(stick[-3:].max() / early)
    slips.append(np.median(slip[-n:]) / np.median(slip[:n]))
    print(
        f"face {i + 1:2d}: {len(found):3d} cycles, slips {np.median(slip):4.2f} ms, sticks {early:4.2f} -> {late:4.2f} -> {stick[-3:].max():6.2f} ms"
    )
print("sticks: median of the first fifth of the cycles, of the last fifth, longest of the last three")

# %%
figure = draw_stack(run, DiskStack())

# %%
with plt.rc_context(plot.PAPER):
    figure, (top, bottom) = plt.subplots(2, 1, figsize=(plot.WIDTH, 4.0), layout="constrained", sharex=True, height_ratios=(1, 1.4))
    times = np.linspace(0.0, min(run.end, rest + 0.1), 4000)
    top.plot(times, run.at(times)["stack.wheel_speed"], **plot.LINES[0])
    top.set(ylabel="wheel [rad/s]", ylim=(0, None))
    for i in range(16):
        for first, last in measure.stick_intervals(run, f"stack.{i}"):
            bottom.plot([first, last], [i + 1, i + 1], color="0.2", linewidth=3.0, solid_capstyle="butt")
    bottom.set(xlabel="time [s]", ylabel="face; dark: stick", ylim=(0.3, 16.7), yticks=(1, 4, 8, 12, 16), xlim=(0, times[-1]))

# %% [markdown]
# **Answer.** In the stick-slip before standstill the slips of a face keep their length, while its sticks grow: by the median over the
# faces, those of the last fifth of the cycles are half as long again as those of the first, and at the very end more than
# tenfold on some faces.

# %%
answer = {
    "sticks, last fifth over first": float(np.median(growth)),
    "sticks, end over first fifth, largest of faces": float(np.max(ends)),
    "slips, last fifth over first": float(np.median(slips)),
    "rest": rest,
}
print("\n".join(f"{name:48} {value:.4g}" for name, value in answer.items()))
