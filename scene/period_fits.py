"""Least squares of the orders in each period of a measured motion, at the times of its samples as
they are.

Of a motion whose `power`-th derivative by tau was measured, each period has its own polynomial of
degree ``2 - power`` (an offset, a drift, a constant acceleration) beside the orders.  So a period
says nothing of where the motion has drifted to, and white noise in the acceleration moves the fits
of different periods independently.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray

from rattle.scene.elementary import unknown
from rattle.scene.types import Bools, Floats, Ints

Waves = NDArray[np.complex128]
FULL_TURN = 2.0 * np.pi
SPARE_ROWS = 1.25  # rows over columns below which a period is not fitted
STEP_NODES = (np.arange(4) + 0.5) / 4.0  # shares of a step at which the drive is integrated


@dataclass(frozen=True)
class Samples:
    """Phase of the drive at each sample, and the `power`-th derivative by it of the motion in
    mm."""

    tau: Floats
    values: Floats
    power: int

    def select(self, rows: Bools) -> "Samples":
        """Some of the samples."""
        return Samples(self.tau[rows], self.values[rows], self.power)


@dataclass(frozen=True)
class PeriodFits:
    """The orders of the acceleration in each window of `cycle` periods.

    Order ``j / cycle`` of window k is the real part of ``waves[k, j - 1] exp(i j tau / cycle)``; a
    window with too few samples has NaN.
    """

    orders: Floats
    waves: Waves
    cycle: int

    @property
    def fitted(self) -> Bools:
        """Which windows have enough samples."""
        return np.isfinite(self.waves[:, 0])

    @property
    def filled(self) -> Waves:
        """The waves, with 0 in place of NaN."""
        return np.where(self.fitted[:, None], self.waves, 0.0)


def count_periods(tau: Floats) -> int:
    """Whole periods from the first sample to one step after the last."""
    end = tau[-1] + (tau[-1] - tau[0]) / (len(tau) - 1)
    return int(end / FULL_TURN + 1e-6)


def _windows(samples: Samples, cycle: int, highest: int) -> Iterator[tuple[Ints, Floats]]:
    """Rows of each window, and its design matrix: polynomial, cosines, sines."""
    length = FULL_TURN * cycle
    number = count_periods(samples.tau) // cycle
    bounds = np.searchsorted(samples.tau, length * np.arange(number + 1) - 1e-9)
    for k in range(number):
        rows = np.arange(bounds[k], bounds[k + 1])
        angle = samples.tau[rows] / cycle - FULL_TURN * k
        waves = np.outer(angle, np.arange(1, cycle * highest + 1))
        drift = legvander(angle / np.pi - 1.0, 2 - samples.power)
        yield rows, np.hstack([drift, np.cos(waves), np.sin(waves)])


def fit_periods(samples: Samples, highest: int, cycle: int = 1) -> PeriodFits:
    """Fit orders ``j / cycle`` up to the highest one in each window of `cycle` periods."""
    orders = np.arange(1, cycle * highest + 1) / cycle
    waves = []
    for rows, design in _windows(samples, cycle, highest):
        wave = np.full(len(orders), np.nan + 0j)
        if len(rows) >= SPARE_ROWS * design.shape[1]:
            values = samples.values[rows]
            fitted = np.linalg.solve(design.T @ design, design.T @ (values - values.mean()))[
                3 - samples.power :
            ]
            wave = (fitted[: len(orders)] - 1j * fitted[len(orders) :]) * (1j * orders) ** (
                2 - samples.power
            )
        waves.append(wave)
    return PeriodFits(orders, np.array(waves), cycle)


def evaluate(orders: Floats, wave: Waves, tau: Floats) -> Floats:
    """The sum of orders."""
    total = np.zeros(np.shape(tau))
    for order, one in zip(orders, wave, strict=True):
        total += np.real(one * np.exp(1j * order * tau))
    return total


def project(waves: Waves, mean: Waves) -> Waves:
    """What the waves of each period are of the mean ones; the imaginary part is of a shift in
    phase."""
    return np.asarray((waves * np.conj(mean)).sum(axis=1) / (np.abs(mean) ** 2).sum())


def measure_gains(samples: Samples, highest: int, mean: Waves) -> tuple[Floats, Floats]:
    """Variance of the real part of `project` in each period, for white noise of the drive and of
    the measurement.

    The first is for ``sigma = alpha``, the second for noise of the samples of sd 1.  With weights q
    of the samples and white noise ``m`` of the acceleration ``a``, the period's is ``integral of K
    a m`` with ``K(s) = sum over t_j > s of q_j (t_j - s)`` for a displacement and ``sum of q_j``
    for a speed; each sample of an acceleration is taken as the mean over its step.
    """
    orders = np.arange(1.0, highest + 1.0)
    size = (np.abs(mean) ** 2).sum()
    target = (1j * orders) ** (2 - samples.power) * np.conj(mean) / size
    aim = np.concatenate([np.zeros(3 - samples.power), np.real(target), np.imag(target)])
    drive, own = unknown(2, count_periods(samples.tau))
    for k, (rows, design) in enumerate(_windows(samples, 1, highest)):
        if len(rows) < SPARE_ROWS * design.shape[1]:
            continue
        q = design @ np.linalg.solve(design.T @ design, aim)
        tau = samples.tau[rows]
        own[k] = q @ q
        if samples.power == 2:
            a = evaluate(orders, mean, tau)
            drive[k] = (q**2 * a**2 / np.gradient(tau)).sum()
            continue
        step = np.diff(tau)
        ahead = np.cumsum(q[::-1])[::-1][1:]  # sum of the weights from the end of each step on
        kernel = np.repeat(ahead[:, None], len(STEP_NODES), axis=1)
        if samples.power == 0:
            at_end = np.append(np.cumsum((ahead * step)[::-1])[::-1][1:], 0.0)
            kernel = at_end[:, None] + ahead[:, None] * step[:, None] * (1.0 - STEP_NODES)
        a = evaluate(orders, mean, tau[:-1, None] + step[:, None] * STEP_NODES)
        drive[k] = ((kernel * a) ** 2 * step[:, None] / len(STEP_NODES)).sum()
    return drive, own


def measure_own_noise(samples: Samples, orders: Floats, mean: Waves) -> tuple[float, float]:
    """Variance of white noise of the measurement, with its standard error; it may come out
    negative.

    Steps of a speed, and bends of a displacement, that share one sample and no time share the noise
    of that sample alone.  An acceleration has it where that of the drive vanishes.
    """
    from scipy.ndimage import uniform_filter1d

    acceleration = evaluate(orders, mean, samples.tau)
    if samples.power == 2:
        rest = samples.values - acceleration
        # an offset that may drift
        rest -= uniform_filter1d(rest, len(rest) // count_periods(samples.tau))
        strength = acceleration**2 / np.gradient(samples.tau)
        (_, slope), covariance = np.polyfit(strength, rest**2, 1, cov=True)
        return float(slope), float(np.sqrt(covariance[1, 1]))
    rest = samples.values - evaluate(
        orders, mean / (1j * orders) ** (2 - samples.power), samples.tau
    )
    step = np.diff(samples.tau)
    if samples.power == 1:
        change = np.diff(rest)
        change -= change.mean()
        products = -change[1:] * change[:-1]
    else:
        bend = np.diff(np.diff(rest) / step)
        products = bend[2:] * bend[:-2] * step[1:-2] * step[2:-1]
    return float(products.mean()), float(products.std() / np.sqrt(len(products)))
