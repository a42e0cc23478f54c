# %% [markdown]
# # Bistability: reading an onset report
#
# **Question.** A stiff drive runs a drill string smoothly at 95 rpm. Is the string safe there?
#
# **Theory.** Two borders belong to a machine with falling friction. From smooth running a small disturbance grows only below the *Hopf
# speed*, $\omega_H = \ln(W R_b (\mu_s - \mu_c)\gamma / d)/\gamma$, where friction falls as steeply as the drive can damp ($d$). Stick-slip
# that has begun lives on until its cycle can no longer reach zero speed, and that is often far above. Between the two, both motions are
# stable: the string runs smoothly until something disturbs it, and then sticks and slips for ever. `onset` finds both borders and never
# reports one without the other.

# %%
from pathlib import Path

import toolbox
from toolbox import Scene, equilibrium, onset, plot, simulate

scene = Scene.load(Path(toolbox.__file__).parents[1] / "studies" / "scenes" / "jansen_2.toml")
report = onset(scene["stiff PI"], "top.reference", (3.0, 14.0), num_values=8, tolerance=0.05)
print(report)

# %% [markdown]
# How to read it, from the top: the **Hopf point** is exact and says nothing about what a jolt does. **Smooth running is lost** is the same
# border by simulation, and a check of it. **Existing stick-slip ends** is the border that matters to whoever already hears the string.
# Between the two lies the band called **bistable**. The sentence below them places the working point, with its margin to both. The table
# has what each run came to.

# %%
axis = report.plot()

# %% [markdown]
# The proof at the working point: one plant, one drive, one set-point, two pasts. The first run starts at the steady state. The second
# starts there too, but for eight seconds the weight on bit is half as large again.

# %%
loop = scene["stiff PI"]
steady = equilibrium(loop, mode={"bit": "slip+"})
jolt = ([60.0, 60.0, 68.0, 68.0], [97_347.0, 146_000.0, 146_000.0, 97_347.0])
calm = simulate(loop, 200.0, start=steady)
struck = simulate(loop, 200.0, start=steady, inputs={"bit.weight": jolt})
axes = plot.comparison({"undisturbed": calm, "heavier for 8 s at 60 s": struck}, "bit.speed")

# %% [markdown]
# **Answer.** The string is not safe at 95 rpm: smooth running is stable from 4.3 rad/s on, but stick-slip lives up to 12.4 rad/s, nearly
# three times as fast. Eight seconds of a heavier bit are enough, and a margin to the Hopf point alone would have promised the opposite.

# %%
answer = {
    "Hopf speed": report.hopf[0].value,
    "end of stick-slip": report.end,
    "ratio": report.end / report.hopf[0].value,
    "stuck, undisturbed": calm.time_in("bit", "stick", after=150.0),
    "stuck after the jolt": struck.time_in("bit", "stick", after=150.0),
}
print("\n".join(f"{name:24} {value:.4g}" for name, value in answer.items()))
