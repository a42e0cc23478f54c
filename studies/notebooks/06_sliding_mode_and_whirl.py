# %% [markdown]
# # Sliding mode and lateral instability
#
# **Question.** A sliding mode ends stick-slip of the bit. Can its gain be too good for the collar above the bit?
#
# **Theory.** Breaking the bit free, a strong weight $\lambda$ of the speed difference lets the bit run ahead. An eccentric collar in its
# hole whirls with it and reaches the wall at $\Omega_c = \sqrt{(k_l/m)\,gap/(gap + e)}$. Beyond it the collar strikes, friction turns its
# whirl backward, and rolling along the wall then lasts down to a much lower speed. So the bit may turn evenly and the collar suffer: a gain
# must be judged by both. The model stands in for that of Hong and Dhupia (a reconstruction with numbers published at UFRJ).

# %%
import matplotlib.pyplot as plt

from models import WhirlingCollar
from studies.questions.whirl import SLIDING, WEIGHT, draw, driven, row, table
from toolbox import plot

runs = {"stiff PI": driven(None), "sliding mode, 0.2 1/s": driven(0.2), "sliding mode, 0.6 1/s": driven(0.6)}
rows = {label: row(run) for label, run in runs.items()}
print(table(rows))

# %%
figure = draw({label: (run, first) for (label, run), first in zip(runs.items(), (45.0, 8.0, 8.3), strict=True)})

# %% [markdown]
# The moment that decides: the bit breaks free, and its overshoot is what carries the collar to the wall, or does not.

# %%
with plt.rc_context(plot.PAPER):
    figure, ax = plt.subplots(figsize=(plot.WIDTH, 2.6), layout="constrained")
    for (label, run), style in zip(list(runs.items())[1:], plot.LINES, strict=False):
        shown = run.time < 30.0
        ax.plot(run.time[shown], run["bit.speed"][shown], label=label, **style)
    wall = WhirlingCollar().contact_speed(WEIGHT, SLIDING)
    ax.axhline(wall, color="0.3", linewidth=0.8, linestyle=(0, (4, 2)))
    ax.text(29.5, wall + 0.3, "whirl reaches the wall", ha="right", va="bottom", fontsize=8)
    ax.set(xlabel="time [s]", ylabel="bit speed [rad/s]", xlim=(0, 30), ylim=(-0.5, 26))
    ax.legend(frameon=False, loc="lower right")

# %% [markdown]
# **Answer.** Under the stiff drive the bit sticks and slips. Both gains end that, and the bit tells no difference; but at 0.6 1/s the
# collar strikes the wall hundreds of times on the way, at 0.2 1/s not once. How many impacts there are depends on every digit, that there
# are many does not.

# %%
answer = {label: {"stuck": r["stuck"], "severity": r["severity"], "impacts": r["impacts"], "peak": r["peak"]} for label, r in rows.items()}
answer["speed at which whirl reaches the wall"] = wall
