r"""
An oscillator that strikes a wall
=================================

:math:`x'' + \beta x' + x = \sigma\xi`, a wall where the spring is relaxed, and no loss at impacts:
the stationary motion is known.  The wall is struck every :math:`\pi` units of time, and the speeds
of impacts have Rayleigh's density with the scale :math:`\sigma/\sqrt{2\beta}`.
"""

import matplotlib.pyplot as plt
import numpy as np

from rattle import Record, Scene, Start, Wheel, simulate

mass = Wheel(beta=0.2, gap=0.0, stiffness=1.0, one_sided=True, name="mass")
start = Start(x1=0.0, y1=-1.0)
scene = Scene(alpha=0.0, epsilon=1.0, sigma=0.5, noise="mass", wheels=[mass], start=start)
run = simulate(scene, paths=20_000, impacts=20, rng=7, workers=2, record=Record(raw=True))
scale = scene.sigma / np.sqrt(2.0 * mass.beta)
speed = np.linspace(0.0, 4.5 * scale, 300)

figure, ax = plt.subplots(figsize=(6.5, 3.4), layout="constrained")
for impact, color in ((1, "#E69F00"), (20, "0.8")):
    struck = run.raw[:, impact - 1, 3]
    ax.hist(struck, bins=80, density=True, color=color, alpha=0.7, label=f"impact {impact}")
ax.plot(speed, speed / scale**2 * np.exp(-0.5 * (speed / scale) ** 2), "k", label="Rayleigh")
last = run.section.iloc[-1]
ax.set(
    xlabel="velocity $y_1$ before the impact",
    ylabel="density",
    title=f"mean flight to impact 20: {last['flight']:.3f} ± {1.96 * last['se_flight']:.3f}",
)
ax.legend()
plt.show()
