r"""
What the step does
==================

Error of the mean time of the fourth impact over the step: plain Euler-Maruyama finds each impact
half a step late; located impacts have an error of the same order, and a smaller one. Exact flights
have none that can be measured, so they are what the others are compared with.
"""

import matplotlib.pyplot as plt
import numpy as np

from rattle import DAT21, Scene, simulate

scene = Scene.from_gears(DAT21, sigma=0.01)
common = {"paths": 4_000, "impacts": 4, "rng": 7, "workers": 2}
exact = simulate(scene, scheme="exact-flight", **common).section.loc[4]
steps = 0.016 / 2.0 ** np.arange(5)

figure, ax = plt.subplots(figsize=(6, 3.6), layout="constrained")
for scheme, colour in (("euler-maruyama", "#D55E00"), ("euler-maruyama-located", "#0072B2")):
    rows = [simulate(scene, scheme=scheme, dt=dt, **common).section.loc[4] for dt in steps]
    error = [abs(row["tau"] - exact["tau"]) for row in rows]
    ax.errorbar(
        steps,
        error,
        [2 * np.hypot(row["se_tau"], exact["se_tau"]) for row in rows],
        marker="o",
        color=colour,
        label=scheme,
    )
ax.set(xscale="log", yscale="log", xlabel="step", ylabel=r"error of E $\tau$ at impact 4")
ax.legend()
plt.show()
