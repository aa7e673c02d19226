r"""
The density at an impact
========================

At the paper's noise :math:`\sigma = \sqrt\alpha` the velocity before the sixth impact has several
humps: paths have come by different itineraries. ``branching`` is a mixture of Gaussian components
and has the humps; the Edgeworth series around one orbit cannot.
"""

import matplotlib.pyplot as plt
import numpy as np

from rattle import DAT21, Record, Scene, mean_map, simulate
from rattle.compare.report.style import STYLE

scene = Scene.from_gears(DAT21, sigma=DAT21.alpha**0.5)
run = simulate(
    scene, paths=10_000, impacts=6, scheme="exact-flight", rng=7, workers=2, record=Record(raw=True)
)
velocity = np.linspace(-5, 5, 400)

figure, ax = plt.subplots(figsize=(6.5, 3.6), layout="constrained")
ax.hist(run.raw[:, 5, 3], bins=90, range=(-5, 5), density=True, color="0.8", label="simulation")
for closure in ("saltation", "branching"):
    density = mean_map(scene, impacts=6, closure=closure).density(6, "y1", velocity)
    ax.plot(velocity, density, color=STYLE[closure]["color"], lw=2, label=closure)
ax.set(xlabel="velocity $y_1$ before impact 6", ylabel="density")
ax.legend()
plt.show()
