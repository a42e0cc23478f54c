# %% [markdown]
# # Regional stick and slip of a slider
#
# **Question.** A pressed contact does not let go all at once. Which part of it slips, when, and what must a model have to show it: springs in a row, or
# the elastic body itself?
#
# **Theory.** A rounded contact of tangential stiffness $k$ under the load $N$ that is drawn by $x$ sticks within $|s| < a = \sqrt{1 - q}$,
# $q = 2kx/(3\mu N)$, and its force is $F = k x a + \mu N\,[1 - (3a - a^3)/2]$ until all of it slips at $q = 1$. A row of springs with
# Coulomb sliders (Jenkins elements, Iwan model), each with its share of the load, converges to this. An elastic body has no such free number: with $q$ the
# displacements of its contacts and a few modes, $M\ddot q + C\dot q + Kq = f - \sum N_i n_i + \sum T_i t_i$, where every contact is open, sticks, or slips with
# $T_i = -\mu N_i\, s_i/|s_i|$. Where loads are given and all rows slip one way, together they carry $\mu N$, so the last row must let go with the rigid slider.

# %%
import matplotlib.pyplot as plt
import numpy as np

from studies.questions.elastic_sliders import Pull, draw_faces, draw_shares, face_problem, face_run, first_slips, measures, row_run
from studies.questions.sliders import bristle_error, draw_bristles, loops, regional_run
from toolbox import plot

run = regional_run()
modes = [name for name in run.modes if name.startswith("plate.")]
times = np.linspace(0.1, run.end, 1200)
slipping = np.array([run.at(times).modes[name] == "slip" for name in modes])
partial = (slipping.any(axis=0) & ~slipping.all(axis=0)).mean()
whole = slipping.all(axis=0).mean()
print(f"{len(modes)} bristles: part of the contact slips for {100 * partial:.0f} % of the time, all of it for {100 * whole:.0f} %")

# %%
figure = draw_bristles(loops(64, (1.5e-6, 3.5e-6, 7e-6)), run)

# %%
counts = np.array([1, 2, 4, 8, 16, 32, 64])
errors = np.array([bristle_error(int(n)) for n in counts])
order = -np.polyfit(np.log(counts[2:]), np.log(errors[2:]), 1)[0]
with plt.rc_context(plot.PAPER):
    figure, ax = plt.subplots(figsize=(0.6 * plot.WIDTH, 2.8), layout="constrained")
    ax.loglog(counts, errors, "o-", markersize=4, color=plot.LINES[0]["color"])
    ax.set(xlabel="bristles [1]", ylabel=r"largest error of the force / $\mu N$ [1]")
for n, error in zip(counts, errors, strict=True):
    print(f"{n:3d} bristles: error {error:.1e} of mu N")

# %% [markdown]
# Now the body itself: a steel cube of 10 mm from a mesh, reduced to its contacts, on a plate that speeds up at 2.5 mm/s². First eleven rows of nodes under
# loads from statics, every event located; then all 121 nodes, which may open and slip in two directions under their own pressure.

# %%
rows, rigid = row_run(), Pull().rigid_time()
slips = first_slips(rows)
print(f"rows: the first slips at {slips.min():.4f} s, the last at {slips.max():.4f} s; the rigid slider lets go at {rigid:.4f} s")
nodes = face_run(face_problem(10), 1e-3)
found = measures(nodes)
for name, value in found.items():
    print(f"nodes: {name:32}{value:9.4g}")

# %%
figure = draw_shares(rows, nodes)

# %%
figure = draw_faces(nodes)

# %% [markdown]
# **Answer.** Slip grows from the edge inward, in springs and bodies alike. One bristle is wrong by a fifth of the friction force, sixteen by half a percent,
# but their stiffness is assumed. The elastic cube needs no such number: its rows let go one by one over three quarters of the time, and the last
# with the rigid slider. Nodes that may open add what rows cannot have: the pull presses the held edge and lifts the far one, so pressure and bounds change,
# the last node stops sticking some 13 ms before the rigid slider lets go, and the face carries all of $\mu N$ only when all of it slips along the pull.

# %%
answer = {
    "partial": float(partial),
    "whole": float(whole),
    "error of 1": float(errors[0]),
    "error of 16": float(errors[4]),
    "order": float(order),
    "last row over rigid": float(slips.max() / rigid),
    "first row over rigid": float(slips.min() / rigid),
    "share at 0.16 s": found["share at 0.16 s"],
    "share at 0.20 s": found["share at 0.20 s"],
    "nodes before rigid": float(rigid - found["no node sticks from [s]"]),
}
print("\n".join(f"{name:20} {value:.3g}" for name, value in answer.items()))
