r"""
Verdicts on every moment
========================

`rattle.compare.validation.validate.validate` compares every closure with a simulation and judges
each moment at each impact: accurate (the whole interval of the error is within what is allowed),
inaccurate (all of it is outside), or undecided.
"""

import matplotlib.pyplot as plt
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch

from rattle import DAT21, Scene, validate

scene = Scene.from_gears(DAT21, sigma=0.05)
verdict = validate(scene, impacts=8, paths=10_000, scheme="exact-flight", rng=7, workers=2)
table = verdict.table.query("kind == 'section' and quantity in ('tau', 'y1', 'y2')")

names = ["accurate", "undecided", "inaccurate", "not predicted"]
colours = ["#009E73", "#F0E442", "#D55E00", "#DDDDDD"]
figure, axes = plt.subplots(1, 4, figsize=(9, 3), sharey=True, layout="constrained")
for ax, (closure, rows) in zip(axes, table.groupby("closure", sort=False), strict=True):
    rows = rows.assign(row=rows["moment"].replace("mean", "E") + " " + rows["quantity"])
    grid = rows.pivot(index="row", columns="impact", values="verdict").map(names.index)
    ax.pcolormesh(
        grid.columns,
        range(len(grid)),
        grid,
        cmap=ListedColormap(colours),
        vmin=0,
        vmax=3,
        edgecolor="w",
    )
    ax.set(title=closure, xlabel="impact", xticks=range(1, 9))
    ax.set_yticks(range(len(grid)), grid.index)
figure.legend(
    handles=[Patch(color=c, label=n) for c, n in zip(colours, names, strict=True)],
    loc="outside lower center",
    ncols=4,
    frameon=False,
)
plt.show()
