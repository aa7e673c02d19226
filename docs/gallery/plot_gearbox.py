r"""
What an engineer turns: drag, backlash and speed of a gearbox
=============================================================

The gears of ``examples/gearbox.toml``, two loose wheels of a car's gearbox at idle. How many
impacts a second are faster than 3 mm/s, and how much power all impacts take, while one value is
turned and all others stay as they were typed. Bars are 95 % intervals.

More drag on wheel 1 takes a third of the power near 315 N mm, where mesh 1 would stay closed
without noise; the number of these impacts even grows. Less backlash makes more impacts and weaker
ones. The firing frequency of the engine goes with its speed: the power grows with about its cube.
"""

import math

import matplotlib.pyplot as plt
import numpy as np

from rattle import Scene, stationary
from rattle.compare.report.style import axis_label

SLOW = 3.0  # mm/s
MESHES = {
    "both meshes": ("", "#000000", "D"),
    "mesh 1": ("_mesh1", "#0072B2", "o"),
    "mesh 2": ("_mesh2", "#D55E00", "s"),
}

gearbox = Scene.load("../../examples/gearbox.toml")  # from the folder of this script


def drag(torque):
    return gearbox.with_gears(torque1=torque)


def play(backlash):
    changed = gearbox.with_gears(backlash1=backlash)
    # the same 3 % of modulation up to 50 Hz, whatever the amplitude in units of the backlash
    return changed.with_sigma(changed.gears.sigma_from(rms=0.03, bandwidth=50.0))


def speed(rpm):
    # a four-cylinder engine fires twice a turn
    changed = gearbox.with_gears(speed_rpm=rpm, omega=2.0 * rpm * 2.0 * math.pi / 60.0)
    return changed.with_sigma(changed.gears.sigma_from(rms=0.03, bandwidth=50.0))


SWEEPS = {
    "torque1": (drag, np.geomspace(5.0, 300.0, 6)),
    "backlash1": (play, np.linspace(0.05, 0.3, 6)),
    "speed_rpm": (speed, np.linspace(600.0, 1600.0, 6)),
}
figure, axes = plt.subplots(3, 2, figsize=(7.5, 8.5), layout="constrained")
for row, (name, (scene_at, values)) in zip(axes, SWEEPS.items(), strict=True):
    scenes = [scene_at(value) for value in values]
    tables = [
        stationary(
            scene,
            periods=64,
            paths=16,
            burn_in=16,
            closures=(),
            rng=7,
            slow=SLOW / scene.gears.units.speed,
        ).table_in("physical")
        for scene in scenes
    ]
    for ax, quantity in zip(row, ("rate_above", "power"), strict=True):
        for label, (mesh, color, marker) in MESHES.items():
            key = quantity + mesh
            value, low, high = np.array(
                [table.loc[key, ["value", "low", "high"]].to_numpy(float) for table in tables]
            ).T
            bars = {"yerr": [value - low, high - value], "capsize": 2, "ms": 4, "lw": 1}
            ax.errorbar(values, value, **bars, color=color, marker=marker, label=label)
        ax.set(xlabel=axis_label(name), ylim=(0.0, None))
    row[0].set_ylabel("impacts a second above 3 mm/s")
    row[1].set_ylabel("power lost, mW")
axes[0, 0].legend()
plt.show()
