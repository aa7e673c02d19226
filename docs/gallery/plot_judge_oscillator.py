r"""
Samples of another simulator: an impact oscillator
==================================================

.. math:: x'' + 2 \zeta x' + x = \sigma \xi, \quad x \ge 0, \quad v^+ = -r v^-

is no pair of gears, and its paths are sampled here in a few lines of numpy. A Gaussian closure
written by hand follows mean and covariance from impact to impact, through the derivative of an
impact (its saltation matrix). ``rattle.judge`` says where it holds; the paths at twice the step
show what the step does. For r = 1 the oscillator strikes its wall :math:`1/\pi` times a unit of
time in the long run, whatever the noise.
"""

import numpy as np
import pandas as pd
from scipy.linalg import expm, solve_continuous_lyapunov

from rattle import Tolerances, judge

ZETA, SIGMA, SPEED, IMPACTS = 0.05, 0.06, 2.0, 6
DRIFT = np.array([[0.0, 1.0], [-1.0, -2.0 * ZETA]])
STATIONARY = solve_continuous_lyapunov(DRIFT, -np.diag([0.0, SIGMA**2]))


def sample(paths, dt, restitution, until=None):
    """Time and speed of the first impacts of each path, or the impacts per unit of time."""
    rng = np.random.default_rng(1)
    step = expm(dt * DRIFT)
    spread = np.linalg.cholesky(STATIONARY - step @ STATIONARY @ step.T)
    state, struck = np.zeros((2, paths)), np.zeros(paths, int)
    state[1] = SPEED
    if until:  # from the stationary motion of r = 1: a Gaussian, cut at the wall
        state = np.sqrt(STATIONARY.diagonal())[:, None] * rng.normal(size=(2, paths))
        state[0] = abs(state[0])
    found = np.full((paths, IMPACTS, 2), np.nan)
    for k in range(int((until or 40.0) / dt)):
        before, state = state, step @ state + spread @ rng.normal(size=(2, paths))
        for i in np.flatnonzero((state[0] < 0.0) & (state[1] < 0.0)):
            share = before[0, i] / max(before[0, i] - state[0, i], 1e-12)
            if struck[i] < IMPACTS:
                found[i, struck[i]] = dt * (k + share), -state[1, i]
            struck[i] += 1
            state[:, i] = 0.0, -restitution * state[1, i]
        if until is None and struck.min() >= IMPACTS:
            break
    return struck / until if until else found


def gaussian(restitution):
    """Moments of time and speed at each impact, from a linear flight and its saltation."""
    rows, time, speed, covariance = [], 0.0, SPEED, np.zeros((3, 3))  # of (time, x, v)
    flight = np.pi / np.sqrt(1.0 - ZETA**2)
    for _ in range(IMPACTS):
        step = expm(flight * DRIFT)
        full = np.block([[np.eye(1), np.zeros((1, 2))], [np.zeros((2, 1)), step]])
        covariance = full @ covariance @ full.T
        covariance[1:, 1:] += STATIONARY - step @ STATIONARY @ step.T
        time, arriving = time + flight, -(step @ [0.0, speed])[1]
        pull = 2.0 * ZETA * arriving  # acceleration at the wall
        early = np.array([[1.0, 1.0 / arriving, 0.0], [0.0, 0.0, 0.0], [0.0, pull / arriving, 1.0]])
        at_wall = early @ covariance @ early.T
        sds = np.sqrt(at_wall.diagonal())
        rows.append([time, arriving, sds[0], sds[2]])
        speed = restitution * arriving
        # a path that strikes later by dt starts later by dt: in its own time it starts at the wall
        leap = np.diag([1.0, 0.0, -restitution]) @ early
        covariance = leap @ covariance @ leap.T
    names = ["time", "speed", "sd_time", "sd_speed"]
    return pd.DataFrame(rows, pd.RangeIndex(1, IMPACTS + 1, name="impact"), names)


fine, coarse = (sample(20_000, dt, 0.9) for dt in (0.005, 0.01))
found = judge(gaussian(0.9), fine, coarser=coarse, names=["time", "speed"])
print(found)
rates = [sample(2000, dt, 1.0, until=100.0)[:, None] for dt in (0.005, 0.01)]
limits = Tolerances(mean=0.2)  # of the sd of a path's rate: about 0.2 % of the rate
exact = {"rate": 1.0 / np.pi}
print(judge(exact, {"rate": rates[0]}, coarser={"rate": rates[1]}, tolerances=limits))
figure = found.plot()
