"""Make driver-speed.csv: the speed of an input shaft at idle, with a drive and a noise that are
known.

Run it in this folder: `python make_driver_speed.py`.  The drive is that of engine-orders.toml on a
base radius of 32 mm; the noise modulates it by white noise of sigma = 0.05 alpha, which makes the
speed wander.
"""

import math
from pathlib import Path

import numpy as np

OMEGA = 167.6
MEAN_RPM = 800.0
PERIODS = 100
SAMPLES = 48
FINER = 16
ORDERS = ((1, 0.014, 0.0), (2, 0.0025, 1.1), (3, 0.0006, -0.4))  # order, amplitude in rad, phase
SIGMA = 0.05  # over alpha

rng = np.random.default_rng(1)
step = 2.0 * math.pi / (SAMPLES * FINER)
tau = step * np.arange(PERIODS * SAMPLES * FINER + 1)
velocity = sum(a * j * np.cos(j * tau + p) for j, a, p in ORDERS)
acceleration = -sum(a * j * j * np.sin(j * tau + p) for j, a, p in ORDERS)
middle = 0.5 * (acceleration[1:] + acceleration[:-1])
wander = np.concatenate(
    [[0.0], np.cumsum(middle * SIGMA * math.sqrt(step) * rng.normal(size=len(middle)))]
)
speed = MEAN_RPM + OMEGA * (velocity + wander) * 60.0 / (2.0 * math.pi)
rows = [
    f"{1e3 * t / OMEGA:.4f},{v:.3f}" for t, v in zip(tau[:-1:FINER], speed[:-1:FINER], strict=True)
]
Path("driver-speed.csv").write_text(
    "\n".join(["time [ms],speed [rpm]", *rows, ""]), encoding="utf-8"
)
