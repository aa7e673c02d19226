r"""
A reference that cannot be believed: a bouncing ball with noisy drag
====================================================================

.. math:: dv = -(g + \nu v |v|) dt + s v |v| dW, \quad v^+ \sim N(-c v^-, s_v^2)

Wang and Lee (arXiv 2003.01201) simulate this ball with a step of 0.025. At that step the *sample*
is wrong: after six units of time it has nearly twice the energy that small steps give, because a
ball near rest is lifted by every impact that comes a step late. Given samples at twice the step,
``rattle.judge`` sees it: rows whose bias exceeds the tolerance stay undecided, and the answer
says that the samples cannot be believed there. Without them it would call the right values wrong.
"""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from rattle import judge

GRAVITY, DRAG, NOISE, RESTITUTION, SPREAD = 9.8, 0.05, 0.01, 0.95, 0.5
TIMES = np.arange(1.0, 7.0)


def energies(paths, dt, seed):
    """Energy of each path at `TIMES`, by Euler-Maruyama; below the floor the speed is drawn."""
    rng = np.random.default_rng(seed)
    x, v = rng.normal(1.5, 0.2, paths), rng.normal(0.0, 0.5, paths)
    out = np.empty((paths, len(TIMES)))
    for k in range(1, round(TIMES[-1] / dt) + 1):
        kick = np.sqrt(dt) * rng.normal(size=paths)
        x, v = x + v * dt, v - (GRAVITY + DRAG * v * abs(v)) * dt + NOISE * v * abs(v) * kick
        struck = (x < 0.0) & (v < 0.0)
        v[struck] = rng.normal(-RESTITUTION * v[struck], SPREAD)
        x[struck] = 0.0
        row = np.flatnonzero(np.isclose(TIMES, k * dt, atol=0.5 * dt))
        if row.size:
            out[:, row[0]] = GRAVITY * x + 0.5 * v**2
    return out


STEPS = (0.05, 0.025, 0.0125, 0.00625, 0.003125)
samples = {dt: energies(10_000, dt, seed) for seed, dt in enumerate(STEPS)}
small = samples[STEPS[-1]]
index = pd.Index(TIMES, name="time")
claim = pd.DataFrame({"energy": small.mean(axis=0), "sd_energy": small.std(axis=0)}, index)

alone = judge(claim, {"energy": samples[0.025]})
print(alone)
checked = judge(claim, {"energy": samples[0.025]}, coarser={"energy": samples[0.05]})
print(checked)

figure, ax = plt.subplots(figsize=(6, 3.6), layout="constrained")
for dt, values in samples.items():
    ax.plot(TIMES, values.mean(axis=0), marker="o", ms=4, label=f"step {dt:g}")
ax.set(xlabel="time", ylabel="mean energy", ylim=(0.0, None))
ax.legend()
plt.show()
