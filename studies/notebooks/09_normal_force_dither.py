# %% [markdown]
# # Normal-force dither: a band, not a cure-all
#
# **Question.** A contact sticks and slips. Does it help to shake the force that presses it, and at which frequency?
#
# **Theory.** Fast dither *along* the slip turns dry friction into a drag: averaged over a period, $\bar\mu(v) = \frac{1}{2\pi}\int\mu(v + B
# \sin\tau)\,d\tau$ rises with $v$ below $B$. Dither of the *normal load*, $N = N_0(1 + a\sin 2\pi f t)$, does nothing of the kind: friction
# is proportional to $N$, so that its mean stays what it was. It works by entrainment, where the dither takes the cycle along, in a band of
# frequencies above the natural one $f_0$. Below the band it amplifies the swing; far above it the effect fades. The block on a belt of
# Leine et al. (1998).

# %%
import matplotlib.pyplot as plt
import numpy as np

from controllers import NormalDither, dither_map
from models import averaged_friction, oscillators
from studies.questions.dither import LEINE
from toolbox import measure, plot, simulate

ratios, depths = np.geomspace(0.25, 12.0, 25), np.arange(1, 10) / 10
found = dither_map(
    LEINE.plant, LEINE.load, LEINE.mean, LEINE.natural, contact="belt", signal="block.position", ratios=ratios, depths=depths
)  # fmt: skip
band = np.array(found.band(0.8)) / LEINE.natural
print(f"depth 0.8: the swing is below a half from {band[0]:.2g} to {band[1]:.2g} times the natural frequency")
print(f"the largest swing on the map is {found.swing.max():.2f} of that without dither")

# %%
law = oscillators.LEINE.friction
slips = np.linspace(0.005, 1.0, 120)
with plt.rc_context(plot.PAPER):
    figure, (left, right) = plt.subplots(1, 2, figsize=(plot.WIDTH, 2.9), layout="constrained", gridspec_kw={"width_ratios": (1.35, 1)})
    levels = [0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0]
    shades = left.contourf(ratios, depths, found.swing, levels=levels, cmap="gray_r", extend="max")
    left.contour(ratios, depths, found.swing, levels=[0.5], colors="tab:orange", linewidths=1.6)
    left.set(xscale="log", xlabel="frequency / natural frequency [1]", ylabel="depth of the dither [1]")
    left.set_xticks([0.3, 0.5, 1, 2, 3, 5, 10], ["0.3", "0.5", "1", "2", "3", "5", "10"])
    left.minorticks_off()
    figure.colorbar(shades, ax=left, label="swing / swing without [1]")
    for style, amplitude in zip(plot.LINES, (0.0, 0.25, 0.5), strict=False):
        right.plot(slips, [averaged_friction(law, v, amplitude) for v in slips], label=f"B = {amplitude:g} m/s", **style)
    right.set(xlabel="slip speed [m/s]", ylabel="mean friction [N]", ylim=(0, 1.05), xlim=(0, 1))
    right.legend(frameon=False, loc="upper right", title="dither along the slip")

# %% [markdown]
# Left: what dither of the load does, by 225 simulations (orange: half of the swing). Right: dither along the slip, for comparison; where its
# curve rises, steady sliding is stable. Dither of the load leaves the upper curve as it is.

# %%
frequency, depth = float(np.sqrt(band[0] * band[1])), 0.8
cures = {"none": None, "in the band": frequency, "below the natural frequency": 0.49, "far above": 12.0}
end = 80.0 / LEINE.natural
runs = {
    label: simulate(
        LEINE.plant, end, controller=None if ratio is None else NormalDither(load=LEINE.load, depth=depth, frequency=ratio * LEINE.natural)
    )
    for label, ratio in cures.items()
}
extents = {label: measure.extent(run, "block.position", end / 2) for label, run in runs.items()}
alone = extents["none"].maximum - extents["none"].minimum
swing = {label: (extent.maximum - extent.minimum) / alone for label, extent in extents.items()}
for label, value in swing.items():
    print(
        f"{label:28} swing {value:.2f} of that without, stuck {100 * measure.stuck_ratio(runs[label], 'belt', end / 2):.0f} % of the time"
    )

# %%
with plt.rc_context(plot.PAPER):
    figure, panels = plt.subplots(2, 2, figsize=(plot.WIDTH, 3.6), layout="constrained", sharex=True, sharey=True)
    times = np.linspace(end - 60.0, end, 2400)
    for panel, (label, run) in zip(panels.flat, runs.items(), strict=True):
        panel.plot(times - times[0], run.at(times)["block.position"], **plot.LINES[0])
        panel.set_title(label if cures[label] is None else f"{label}, {cures[label]:.2g} times natural", loc="left", fontsize=9.0)
    figure.supxlabel("time [s]", fontsize=9.0)
    figure.supylabel("position of the block [m]", fontsize=9.0)

# %% [markdown]
# **Answer.** Dither of four fifths of the load halves the swing between about 2.4 and 4.6 times the natural frequency, and only there; dither
# of up to two fifths halves it nowhere. At half of the natural frequency the same dither makes the swing nearly twice as large. That is the
# declared machine: where friction, stiffness, load, amplitude or frequency may be a fifth off, the swing stays at about a half from 3.3 to 3.7
# times the natural frequency only, at a depth of nine tenths, and on a disc brake nowhere (`python -m studies brake_margins`). So measure the map
# of the machine before an actuator is bought: `dither_map(plant, load, ...)`, and `.choice()` of it. `python -m studies dither`
# compares the cures on a brake and on a drill string, too.

# %%
answer = {
    "band": tuple(band),
    "swing": swing,
    "least up to depth 0.4": float(found.swing[depths < 0.45].min()),
    "largest": float(found.swing.max()),
    "mean friction at 0.1 m/s under B = 0.5 m/s": averaged_friction(law, 0.1, 0.5),
    "mean friction at 0.3 m/s under B = 0.5 m/s": averaged_friction(law, 0.3, 0.5),
}
