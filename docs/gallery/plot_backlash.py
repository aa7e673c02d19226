r"""
How hard and how often: the backlash of a gear pair
===================================================

DAT21 with other backlashes and the same motion of the driver: impacts per second, and the speed
with which driver and wheel 1 meet, in mm/s. Physical units follow from the gears: a time is
:math:`\tau/\omega`, a velocity is
:math:`y\,\nu_1\omega`.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

from rattle import DAT21, Record, Scene, simulate

backlashes = np.linspace(0.1, 0.6, 6)  # mm
rate = []
speed = []
for backlash in backlashes:
    gears = replace(
        DAT21,
        backlash1=backlash,
        backlash2=backlash,
        alpha=DAT21.alpha * DAT21.backlash1 / backlash,
    )
    scene = Scene.from_gears(gears, sigma=0.1 * gears.alpha)
    raw = simulate(
        scene,
        paths=500,
        impacts=60,
        scheme="exact-flight",
        rng=7,
        workers=2,
        record=Record(raw=True),
    ).raw
    late = raw[:, 20:]  # the start is forgotten
    rate.append(gears.omega / late[:, :, 1].mean())
    mesh1 = np.abs(late[:, :, 6]) == 1
    speed.append(np.abs(late[:, :, 3])[mesh1].mean() * gears.backlash1 * gears.omega)

figure, axes = plt.subplots(1, 2, figsize=(8, 3.2), layout="constrained")
axes[0].plot(backlashes, rate, "o-", color="#0072B2")
axes[0].set(xlabel="backlash [mm]", ylabel="impacts per second", ylim=(0, None))
axes[1].plot(backlashes, speed, "o-", color="#D55E00")
axes[1].set(xlabel="backlash [mm]", ylabel="mean impact speed at mesh 1 [mm/s]", ylim=(0, None))
plt.show()
