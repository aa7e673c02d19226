r"""
Noise or tolerances?
====================

Backlashes from a drawing scatter from one gear set to the next. The standard deviation of the
impact times of a scene with noise alone, with tolerances alone (0.4 % of the half gap), and with
both: the closure ``saltation`` as lines, the simulation as points.
"""

import matplotlib.pyplot as plt

from rattle import DAT21, Scene, Tolerance, mean_map, simulate

play = Tolerance(0.002, 0.002, distribution="normal", draw="path")
scenes = {
    "noise": Scene.from_gears(DAT21, sigma=0.002),
    "tolerances": Scene.from_gears(DAT21, tolerance=play),
    "both": Scene.from_gears(DAT21, sigma=0.002, tolerance=play),
}

figure, ax = plt.subplots(figsize=(6, 3.6), layout="constrained")
for (name, scene), colour in zip(scenes.items(), ("#0072B2", "#E69F00", "#009E73"), strict=True):
    run = simulate(scene, paths=4_000, impacts=6, scheme="exact-flight", rng=7, workers=2).section
    ax.plot(mean_map(scene, impacts=6).section["sd_tau"], color=colour, label=name)
    ax.plot(run["sd_tau"], "D", color=colour, ms=5)
ax.set_xticks(range(1, 7))
ax.set(xlabel="impact", ylabel=r"sd of the impact time $\tau$", yscale="log")
ax.legend()
plt.show()
