r"""
Chatter, sticking, release
==========================

A single stage with little restitution: impacts accumulate (chatter), the mesh stays closed while its contact force
pushes (shaded), and opens when it would have to pull. The orbit goes through all of it.
"""

from itertools import pairwise

import matplotlib.pyplot as plt

from rattle import Scene, follow
from rattle.scene.flight import flow

scene = Scene(alpha=1.0, epsilon=0.3, beta1=0.0, gamma1=0.8, stages=1)
orbit = follow(scene, impacts=40)
legs = orbit.legs[:42]

figure, ax = plt.subplots(figsize=(7, 3.2), layout="constrained")
times, places = [], []
for leg, after in pairwise(legs):
    for i in range(30):
        t = (after[0] - leg[0]) * i / 30
        times.append(leg[0] + t)
        places.append(leg[1] if leg[5] else flow(scene.constants, *leg[:5], t)[0])
ax.plot(times, places, color="#0072B2")
for phase in orbit.sticking:
    if phase.closed < times[-1]:
        ax.axvspan(phase.closed, min(phase.opened, times[-1]), color="#E69F00", alpha=0.3, lw=0)
for side in (-0.5, 0.5):
    ax.axhline(side, color="0.4", lw=1)
ax.set(xlabel=r"time $\tau$", ylabel="$x_1$ [backlash 1]", xlim=(0, times[-1]))
plt.show()
