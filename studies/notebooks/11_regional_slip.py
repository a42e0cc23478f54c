# %% [markdown]
# # Regional stick and slip of a slider
#
# **Question.** A pressed contact does not let go all at once. Which part of it slips, when, and how many elements does a model need to show
# it?
#
# **Theory.** A rounded contact of tangential stiffness $k$ under the load $N$ that is drawn by $x$ sticks within $|s| < a = \sqrt{1 - q}$,
# $q = 2kx/(3\mu N)$, and its force is $F = k x a + \mu N\,[1 - (3a - a^3)/2]$ until all of it slips at $q = 1$. A row of springs with
# Coulomb sliders (Jenkins elements, Iwan model), each with its share of the load, converges to this; reversals follow Masing's rule. Each
# bristle has its own integer mode.

# %%
import matplotlib.pyplot as plt
import numpy as np

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
# **Answer.** For more than a third of the time only a part of the contact slips, from the edge inward. One element is wrong by a fifth of
# the friction force, sixteen by half a percent, and the error falls nearly with the square of the number of bristles.

# %%
answer = {
    "partial": float(partial),
    "whole": float(whole),
    "error of 1": float(errors[0]),
    "error of 16": float(errors[4]),
    "order": float(order),
}
print("\n".join(f"{name:12} {value:.3g}" for name, value in answer.items()))
