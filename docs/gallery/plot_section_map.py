r"""
The Poincaré section of the orbit
=================================

Flight time against velocity before the impact, at 20,000 impacts of the noise-free orbit: its
strange attractor. In black 4,000 impacts of noisy paths at :math:`\sigma = 0.1` that have forgotten
their start.
"""

import matplotlib.pyplot as plt

from rattle import DAT21, Record, Scene, simulate
from rattle.scene.long_orbit import LongOrbit

scene = Scene.from_gears(DAT21, sigma=0.1)
orbit = LongOrbit(scene.noise_free).stretch(20_000, tangent=False)
run = simulate(
    scene, paths=400, impacts=40, scheme="exact-flight", rng=7, workers=2, record=Record(raw=True)
)
noisy = run.raw[:, 30:].reshape(-1, 7)

figure, ax = plt.subplots(figsize=(6.5, 4), layout="constrained")
ax.plot(orbit.flight, orbit.before[:, 1], ",", color="#0072B2", label="orbit")
ax.plot(noisy[:, 1], noisy[:, 3], "k.", ms=1.2, label="noisy paths")
ax.set(xlabel=r"flight time $\Delta\tau$", ylabel="velocity $y_1$ before the impact", xlim=(0, 2))
ax.legend(markerscale=6, loc="upper right")
plt.show()
