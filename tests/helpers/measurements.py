"""Measurement files of a driver with known orders and noise, as a text for
`rattle.measure_drive`."""

import math

import numpy as np
from scipy.signal import lfilter

RADIUS = 30.0  # mm
UNITS = {  # of each unit in one of mm, mm/s or mm/s^2
    "mm": 1.0,
    "mm/s": 1.0,
    "mm/s^2": 1.0,
    "rad": 1.0 / RADIUS,
    "rad/s": 1.0 / RADIUS,
    "rad/s^2": 1.0 / RADIUS,
    "deg": math.degrees(1.0 / RADIUS),
    "rpm": 30.0 / math.pi / RADIUS,
}
OMEGA = 300.0
TIMES = np.arange(8000) * 2.5e-4
"""Of 95 periods, in s."""
UNITS_OF_POWERS = ("mm", "mm/s", "mm/s^2")
QUANTITIES = ("displacement", "speed", "acceleration")


def motion(tau, power, orders):
    """A derivative by tau of the driver's motion in mm; an order is its number, its amplitude and
    its phase."""
    tau = np.asarray(tau, float)
    waves = [a * j**power * np.sin(j * tau + p + 0.5 * math.pi * power) for j, a, p in orders]
    return np.sum(waves, axis=0)


def wander(rng, ratio, tau, power, orders, finer=8, memory=0.0):
    """What white noise of intensity `ratio` alpha adds to a derivative by tau of the motion, at
    rising times.

    An acceleration is the mean over the step that follows its sample. `memory`: Correlation time of
    the noise.
    """
    edges = np.append(tau, 2.0 * tau[-1] - tau[-2])
    share = np.arange(finer) / finer
    fine = np.append((edges[:-1, None] + np.diff(edges)[:, None] * share).ravel(), edges[-1])
    step = np.diff(fine)
    kicks = ratio * np.sqrt(step) * rng.normal(size=len(step))
    if memory:
        keep = math.exp(-step[0] / memory)
        kicks = lfilter([1.0 - keep], [1.0, -keep], kicks)
    push = motion(0.5 * (fine[1:] + fine[:-1]), 2, orders)
    speed = np.concatenate([[0.0], np.cumsum(push * kicks)])
    if power == 1:
        return speed[:-1:finer]
    if power == 2:
        return np.diff(speed[::finer]) / np.diff(edges)
    within = step**1.5 * push * ratio * rng.normal(size=len(step)) / math.sqrt(12.0)
    path = np.concatenate([[0.0], np.cumsum(0.5 * step * (speed[1:] + speed[:-1]) + within)])
    return path[:-1:finer]


def write(at, values, head="time [s],displacement [mm]"):
    """The text of a file with two columns."""
    rows = (f"{a:.12g},{v:.12g}\n" for a, v in zip(at, values, strict=True))
    return head + "\n" + "".join(rows)


def measure(
    omega,
    orders,
    at,
    *,
    quantity="displacement",
    unit=None,
    ratio=0.0,
    seed=0,
    extra=0.0,
    noise=0.0,
    memory=0.0,
):
    """A file of a drive of constant frequency over times in s.

    `ratio`: Of the noise of the drive to alpha.  `noise`: Sd of that of the measurement, in the
    unit of the file. `extra`: Added to the values, in the unit of the file.
    """
    power = QUANTITIES.index(quantity)
    unit = unit or UNITS_OF_POWERS[power]
    rng = np.random.default_rng(seed)
    tau = omega * np.asarray(at)
    values = motion(tau, power, orders)
    if ratio:
        values += wander(rng, ratio, tau, power, orders, memory=memory)
    values = values * omega**power * UNITS[unit] + extra + noise * rng.normal(size=len(tau))
    return write(at, values, f"time [s],{quantity} [{unit}]")
