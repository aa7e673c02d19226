r"""
The orbit between its walls
===========================

Without noise the motion is one orbit: both relative displacements :math:`x_1` (driver and wheel 1) and :math:`x_2`
(wheels 1 and 2) between their flanks at :math:`\pm g`. A mark is an impact at that mesh; an impact at one mesh bends
the other curve as well, for wheel 1 has a part in both.
"""

import matplotlib.pyplot as plt
import numpy as np

from rattle import DAT21, Scene, follow
from rattle.scene.flight import flow

scene = Scene.from_gears(DAT21)
orbit = follow(scene, impacts=24)

figure, axes = plt.subplots(2, 1, figsize=(7, 4.2), sharex=True, layout="constrained")
for k in range(24):
    times = np.linspace(0, orbit.tau[k + 1] - orbit.tau[k], 40)
    state = np.array([flow(scene.constants, orbit.tau[k], *orbit.after[k], t) for t in times])
    for stage, ax in enumerate(axes):
        ax.plot(orbit.tau[k] + times, state[:, 2 * stage], color="#0072B2")
for stage, ax in enumerate(axes):
    here = orbit.mesh == stage + 1
    ax.plot(
        orbit.tau[here], orbit.before[here, 2 * stage], "o", color="#D55E00", ms=5, label=f"impact at mesh {stage + 1}"
    )
    for side in (-1, 1):
        ax.axhline(side * (scene.gap1, scene.gap2)[stage], color="0.4", lw=1)
    ax.set_ylabel(f"$x_{stage + 1}$ [backlash 1]")
    ax.legend(loc="upper right", bbox_to_anchor=(1, 1.25), frameon=False)
axes[1].set_xlabel(r"time $\tau = \omega t$")
plt.show()
