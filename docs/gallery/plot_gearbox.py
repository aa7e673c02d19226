r"""
What an engineer turns: drag, backlash and speed of a gearbox
=============================================================

The gears of ``examples/gearbox.toml``, two loose wheels of a car's gearbox at idle. How many
impacts a second are faster than 3 mm/s, and how much power all impacts take, while one value is
turned and all others stay as they were typed. Bars are 95 % intervals.
"""

# sphinx_gallery_thumbnail_number = 3
import math

import matplotlib.pyplot as plt
import numpy as np

from rattle import Scene, stationary
from rattle.compare.report.style import axis_label

gearbox = Scene.load("../../examples/gearbox.toml")  # from the folder of this script
SLOW = 3.0  # mm/s
QUANTITIES = {"rate_above": "impacts a second", "power": "power lost, mW"}
MESHES = {
    "both meshes": ("", "#000000", "D"),
    "mesh 1": ("_mesh1", "#0072B2", "o"),
    "mesh 2": ("_mesh2", "#D55E00", "s"),
}


def follow(scene):
    """The long run of a scene in physical units."""
    slow = SLOW / scene.gears.units.speed
    run = {"periods": 64, "paths": 16, "burn_in": 16, "closures": (), "rng": 7}
    return stationary(scene, slow=slow, **run).table_in("physical")


def draw(name, values, scenes):
    """Rate and power over one value of the gears."""
    tables = [follow(scene) for scene in scenes]
    _, axes = plt.subplots(2, 1, figsize=(4.1, 4.8), layout="constrained", sharex=True)
    for ax, (quantity, label) in zip(axes, QUANTITIES.items(), strict=True):
        for where, (mesh, color, marker) in MESHES.items():
            rows = [table.loc[quantity + mesh, ["value", "low", "high"]] for table in tables]
            value, low, high = np.array(rows, float).T
            bars = {"yerr": [value - low, high - value], "capsize": 2, "ms": 4, "lw": 1}
            ax.errorbar(values, value, **bars, color=color, marker=marker, label=where)
        ax.set(ylabel=label, ylim=(0.0, None))
    axes[1].set_xlabel(axis_label(name))
    axes[0].legend()


# %%
# More drag on wheel 1 takes a third of the power near 315 N mm, where mesh 1 would stay closed
# without noise; the number of these impacts even grows.

torques = np.geomspace(5.0, 300.0, 6)
draw("torque1", torques, [gearbox.with_gears(torque1=torque) for torque in torques])
plt.show()

# %%
# Less backlash makes more impacts, and weaker ones. The noise stays the same 3 % of modulation,
# whatever the amplitude in units of the backlash.

backlashes = np.linspace(0.05, 0.3, 6)
scenes = []
for backlash in backlashes:
    scene = gearbox.with_gears(backlash1=backlash)
    scenes.append(scene.with_sigma(scene.gears.sigma_from(rms=0.03, bandwidth=50.0)))
draw("backlash1", backlashes, scenes)
plt.show()

# %%
# A four-cylinder engine fires twice a turn, so the frequency goes with the speed. The power grows
# with about its cube.

speeds = np.linspace(600.0, 1600.0, 6)
scenes = []
for speed in speeds:
    scene = gearbox.with_gears(speed_rpm=speed, omega=4.0 * math.pi * speed / 60.0)
    scenes.append(scene.with_sigma(scene.gears.sigma_from(rms=0.03, bandwidth=50.0)))
draw("speed_rpm", speeds, scenes)
plt.show()
