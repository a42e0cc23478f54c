# %% [markdown]
# # Sliding mode and lateral instability
#
# **Question.** A sliding mode ends stick-slip of the bit. Which gain spares the collar above the bit, and does that depend on how it is started?
#
# **Theory.** Breaking the bit free, a strong weight $\lambda$ of the speed difference lets the bit run ahead. An eccentric collar in its
# hole whirls with it and reaches the wall at $\Omega_c = \sqrt{(k_l/m)\,gap/(gap + e)}$. Beyond it the collar strikes, friction turns its
# whirl backward, and rolling along the wall then lasts down to a much lower speed. The set-point lies between these two speeds, so that the
# collar does what it was last disturbed into: an outcome belongs to a gain *and* a way of starting. The model stands in for that of Hong and
# Dhupia (a reconstruction with numbers published at UFRJ).

# %%
import math

import matplotlib.pyplot as plt

from models import WhirlingCollar
from studies.questions.whirl import (
    OUTCOMES,
    REFERENCE,
    SHOWN,
    SLIDING,
    WAYS,
    WEIGHT,
    draw,
    draw_outcomes,
    driven,
    map_text,
    outcomes,
    row,
    table,
)
from toolbox import plot, use_units

gains, ways = (0.05, 0.1, 0.2, 0.4, 0.8, 1.3), (*WAYS[:3], *WAYS[3::2])
found = outcomes(gains, ways)
print(map_text(found, gains, ways))

# %%
figure = draw_outcomes(found, gains, ways)

# %% [markdown]
# One gain, 0.2 1/s, under three ways of starting: a step of the set-point from rest, a ramp over 60 s, and a takeover from the stiff drive inside
# stick-slip. The bit ends up turning evenly in all three, and the drive sees no difference.

# %%
runs = {way: driven(0.2, way) for way in SHOWN}
print(table({way: row(run) for way, run in {"stiff PI": driven(None), **runs}.items()}))
with use_units("metric"):  # what drillers read: rpm
    figure = draw({way: (run, SHOWN[way]) for way, run in runs.items()})

# %% [markdown]
# What separates them is not the bit but the collar's past: under the stiff drive it strikes the wall in every cycle, and a takeover finds it there.

# %%
with plt.rc_context(plot.PAPER):
    figure, ax = plt.subplots(figsize=(plot.WIDTH, 2.6), layout="constrained")
    for (way, run), style in zip(runs.items(), plot.LINES, strict=False):
        shown = run.time < 60.0
        ax.plot(run.time[shown], 30 / math.pi * run["bit.speed"][shown], label=way, **style)
    wall = WhirlingCollar().contact_speed(WEIGHT, SLIDING)
    rolls = WhirlingCollar().rolling_speed(WEIGHT, SLIDING)
    for speed, word in ((wall, "whirl reaches the wall"), (rolls, "rolling lasts above")):
        ax.axhline(30 / math.pi * speed, color="0.3", linewidth=0.8, linestyle=(0, (4, 2)))
        ax.text(59.5, 30 / math.pi * speed + 3, word, ha="right", va="bottom", fontsize=8)
    ax.set(xlabel="time [s]", ylabel="bit speed [rpm]", xlim=(0, 60), ylim=(-5, 250))
    ax.legend(frameon=False, loc="upper center", ncols=3)

# %% [markdown]
# **Answer.** With the set-point ramped over 60 s the collar never strikes at gains from 0.05 to 0.8 1/s; with a step from rest only at 0.1 and
# 0.2 1/s. Inside existing stick-slip it strikes at every gain. At 0.05, 0.1 and 0.8 1/s it comes off the wall afterwards; at 0.2 and 0.4 1/s it
# ends up rolling along the wall for ever from half of the phases and more, while the bit turns evenly; at 1.3 1/s stick-slip is back. A gain that
# is judged by one step from rest is not judged.

# %%
place = {gain: i for i, gain in enumerate(gains)}
answer = {
    "outcomes": {gain: [OUTCOMES[k] for k in found[i]] for gain, i in place.items()},
    "ways": list(ways),
    "severity": {way: row(run)["severity"] for way, run in runs.items()},
    "stuck under the stiff drive": row(driven(None))["stuck"],
    "speed at which whirl reaches the wall": wall,
    "speed above which rolling lasts": rolls,
    "set-point": REFERENCE,
}
