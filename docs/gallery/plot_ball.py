r"""
A ball on a shaking table
=========================

Under gravity and a random force, from ``examples/ball.toml``.  Above, the motion without noise:
:math:`x_1` is table less ball, so up is down here, and the ball strikes at 0.  Below, the speed
before the first and the fourth impact of noisy paths, beside the densities of two closures.
``rattle animate examples/ball.toml`` shows table and ball in motion.
"""

import matplotlib.pyplot as plt
import numpy as np

from rattle import Record, Scene, follow, mean_map, simulate
from rattle.compare.report.style import STYLE

scene = Scene.load("../../examples/ball.toml")  # from the folder of this script
motion = follow(scene.noise_free, impacts=8).plot()

# %%
run = simulate(scene, paths=20_000, impacts=4, rng=7, workers=2, record=Record(raw=True))
figure, panels = plt.subplots(1, 2, figsize=(7, 3), layout="constrained")
for ax, impact in zip(panels, (1, 4), strict=True):
    struck = run.raw[:, impact - 1, 3]
    ax.hist(struck, bins=80, density=True, color="0.8", label="simulation")
    speed = np.linspace(*np.quantile(struck, [0.0005, 0.9995]), 300)
    for closure in ("saltation", "branching"):
        density = mean_map(scene, impacts=4, closure=closure).density(impact, "y1", speed)
        ax.plot(speed, density, color=STYLE[closure]["color"], lw=2, label=closure)
    ax.set(xlabel=f"velocity $y_1$ before impact {impact}", xlim=(speed[0], speed[-1]))
panels[0].set_ylabel("density")
figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
plt.show()
