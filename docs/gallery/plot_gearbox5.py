r"""
Which wheel of a gearbox rattles most
=====================================

Five loose wheels of a car's gearbox at idle: a layshaft on the driver, and four wheels on its other
toothings.  The long run says how often the teeth of each strike, and what each takes of the energy
that all impacts lose.  The values are made up, in the range of such gearboxes.
"""

import matplotlib.pyplot as plt
import numpy as np

from rattle import Scene, stationary

scene = Scene.load("../../examples/gearbox5.toml")  # from the folder of this script
table = stationary(scene, accuracy=0.05, closures=(), rng=7, workers=2).table_in("physical")
names = scene.wheel_names
wheels = np.arange(1, len(names) + 1)
rates = table.loc[[f"rate_above_mesh{i}" for i in wheels]]
powers = table.loc[[f"power_mesh{i}" for i in wheels]]
whole = table.loc["power", "value"]

figure, (left, right) = plt.subplots(1, 2, figsize=(7, 3.2), layout="constrained", sharey=True)
left.barh(wheels, rates["value"], xerr=1.96 * rates["se"], color="#0072B2", capsize=3)
left.set(xlabel="impacts a second that are not slow", yticks=wheels, yticklabels=names)
left.invert_yaxis()
right.barh(
    wheels, powers["value"] / whole, xerr=1.96 * powers["se"] / whole, color="#D55E00", capsize=3
)
right.set_xlabel("share of the energy lost in impacts")
plt.show()
