r"""
How much noise a closure bears
==============================

The largest error of the means and sds of 8 impacts over the noise intensity, in standard deviations
of each quantity. The linearised closure ``saltation`` fails where paths begin to leave its
itinerary; the mixture ``branching`` follows them. 2,000 paths cannot tell an error below about 0.07
from chance: the grey band.
"""

import matplotlib.pyplot as plt
import numpy as np

from rattle import DAT21, Scene, validate
from rattle.compare.report.style import STYLE

sigmas = np.geomspace(0.01, 1.0, 5)
errors = {"corrected": [], "saltation": [], "branching": []}
for sigma in sigmas:
    scene = Scene.from_gears(DAT21, sigma=sigma)
    found = validate(
        scene,
        impacts=8,
        closures=tuple(errors),
        paths=2_000,
        scheme="exact-flight",
        rng=7,
        workers=2,
    )
    rows = found.table.query(
        "kind == 'section' and verdict in ('accurate', 'inaccurate', 'undecided')"
    )
    worst = (rows["error"] / rows["unit"]).abs().groupby(rows["closure"]).max()
    for closure, values in errors.items():
        values.append(worst[closure])

figure, ax = plt.subplots(figsize=(6, 3.6), layout="constrained")
for closure, values in errors.items():
    ax.plot(sigmas, values, label=closure, **STYLE[closure])
ax.axhspan(1e-2, 0.07, color="0.85", lw=0)
ax.set(
    xscale="log",
    yscale="log",
    xlabel=r"noise intensity $\sigma$",
    ylabel="largest error [sd]",
    ylim=(1e-2, None),
)
ax.legend()
plt.show()
