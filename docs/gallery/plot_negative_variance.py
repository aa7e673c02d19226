r"""
A variance below zero
=====================

The rules that the paper prints for the moments at an impact make variances negative at the second
impact: Eq. 17 those of stage 1, which are drawn here, Eq. 15 those of stage 2. With its algebra
corrected the same method has positive variances, and still not those of the simulation.
"""

import matplotlib.pyplot as plt
import numpy as np

from rattle import DAT21, Scene, mean_map
from rattle.compare.report.style import STYLE

scene = Scene.from_gears(DAT21, sigma=0.01)
impacts = np.arange(1, 9)

figure, ax = plt.subplots(figsize=(6, 3.4), layout="constrained")
for closure in ("published", "corrected"):
    m = mean_map(scene, impacts=8, closure=closure)
    variance = [m.stage_covariance(k, 1)[1, 1] / scene.sigma**2 for k in impacts]
    ax.plot(impacts, variance, label=closure, **STYLE[closure])
ax.axhspan(
    ax.get_ylim()[0], 0, color="#CC79A7", alpha=0.25, lw=0, label="no distribution has these"
)
ax.set_xticks(impacts)
ax.set(xlabel="impact", ylabel=r"variance of $y_1$ / $\sigma^2$")
ax.legend()
plt.show()
