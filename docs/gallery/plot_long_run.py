r"""
The long run over the noise
===========================

Where the excitation is weak the noise-free motion of this single stage is periodic, and the linear
closure has a stationary law: a normal distribution about each impact of the orbit.  The simulation
shows how far it can be believed.
"""

import matplotlib.pyplot as plt
import numpy as np

from rattle import Scene, stationary
from rattle.compare.report.style import STYLE
from rattle.compare.stationary.verdicts import values_of

pair = {"alpha": 0.25, "epsilon": 0.5, "beta1": 0.02, "gamma1": 0.0, "stages": 1}
sigmas = np.geomspace(1e-3, 0.3, 7)
rows = []
for sigma in sigmas:
    found = stationary(
        Scene(**pair, sigma=sigma), periods=128, paths=64, closures=["saltation"], rng=7, workers=2
    )
    values = values_of(found.laws["saltation"], found.scene, found.slow)
    rows.append(
        [
            found.table.loc["sd_speed", "value"],
            found.table.loc["sd_speed", "se"],
            values["sd_speed"],
        ]
    )
simulated, se, linear = np.array(rows).T

figure, ax = plt.subplots(figsize=(6, 3.6), layout="constrained")
ax.errorbar(
    sigmas, simulated, 2.0 * se, ls="none", capsize=2, label="simulation", **STYLE["monte carlo"]
)
ax.plot(sigmas, linear, label="linear closure", **STYLE["saltation"])
ax.set(
    xscale="log",
    yscale="log",
    xlabel=r"noise intensity $\sigma$",
    ylabel=r"sd of the impact speed [$\nu_1\omega$]",
)
ax.legend()
plt.show()
