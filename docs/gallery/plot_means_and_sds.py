r"""
Closure and simulation, impact by impact
========================================

Mean and standard deviation of the velocity :math:`y_1` just before each path's own k-th impact:
three closures as lines, the simulation as points. ``saltation`` meets every point; ``corrected``
has the spread wrong; ``published`` has no standard deviation where its variance is negative.
"""

import matplotlib.pyplot as plt

from rattle import DAT21, Scene, mean_map, simulate
from rattle.compare.report.style import STYLE

scene = Scene.from_gears(DAT21, sigma=0.03)
run = simulate(scene, paths=20_000, impacts=8, scheme="exact-flight", rng=7, workers=2).section

figure, axes = plt.subplots(1, 2, figsize=(8, 3.4), layout="constrained")
for ax, name, label in zip(axes, ("y1", "sd_y1"), ("mean of $y_1$", "sd of $y_1$"), strict=True):
    for closure in ("published", "corrected", "saltation"):
        ax.plot(
            mean_map(scene, impacts=8, closure=closure).section[name],
            label=closure,
            **STYLE[closure],
        )
    ax.errorbar(run.index, run[name], 2 * run[f"se_{name}"], fmt="kD", ms=4, label="simulation")
    low = run[name].min()
    high = run[name].max()
    ax.set_ylim(low - 0.5 * (high - low), high + 0.5 * (high - low))
    ax.set_xticks(range(1, 9))
    ax.set(xlabel="impact", title=label)
axes[0].legend(fontsize=8)
plt.show()
