"""The phase of the drive at each sample of a measured motion, with bad samples left out."""

import math

import numpy as np

from rattle.scene.drive_noise import find_pattern
from rattle.scene.errors import InputError
from rattle.scene.period_fits import TURN, PeriodFits, Samples, count_periods, fit_periods
from rattle.scene.types import Bools, Floats

SLIP = 0.02  # share by which the frequency in the file may differ from the stated one
STRONGEST = 4  # orders by which the frequency is found
PASSES = 6  # of the phase: each shrinks its error by more than ten times
NEIGHBOURS = 11  # samples whose median a sample is compared with: five bad ones in a row are seen
SPIKE = 10.0  # times the usual step from sample to sample, beyond which a sample is bad
USUAL = 0.9  # quantile of the steps
RARE = 0.01  # share of the samples from which on they are no bad ones, but a motion with steps
FAR_PHASE = 0.1  # rad, up to which no period counts as far off
MOST = 0.5  # share of the periods whose phases are to be compared, for a phase to be followed
FASTER = 0.3  # relative change of the frequency that is never a slow one of the stated
EXACT = 1e-9  # rad, up to which the phase is left as it is
ALIKE = 2.0  # factor between the sizes of two periods, up to which their phases are compared


def is_spike(values: Floats, least: float = 0.0) -> Bools:
    """Which samples stand out from their neighbours, far more than samples move from one to the next."""
    from scipy.ndimage import median_filter

    off = np.abs(values - median_filter(values, NEIGHBOURS, mode="nearest"))
    step = float(np.quantile(np.abs(np.diff(values)), USUAL))
    spikes = off > max(SPIKE * step, least)
    return np.asarray(spikes & (spikes.mean() <= RARE))


def find_shift(fits: PeriodFits, slip: float) -> float:
    """The relative change of the frequency, up to `slip`, at which the strongest orders of all periods add up to most."""
    waves, number = fits.waves[fits.fitted], np.flatnonzero(fits.fitted)
    size = np.abs(waves)
    usual = np.median(np.linalg.norm(size, axis=1))
    waves = waves * np.minimum(1.0, usual / np.linalg.norm(size, axis=1))[:, None]
    usable = fits.orders * slip < 0.4  # of a turn in a period: the direction of a faster one is not known
    strongest = np.argsort(np.where(usable, np.median(size, axis=0), 0.0))[-STRONGEST:]
    shares = np.linspace(-slip, slip, 1 + 2 * math.ceil(8.0 * slip * fits.orders[strongest].max() * len(fits.waves)))
    power = np.zeros(len(shares))
    for j in strongest:
        turns = np.outer(shares, fits.orders[j] * number)
        power += np.abs(np.exp(-1j * TURN * turns) @ waves[:, j]) ** 2
    return float(shares[power.argmax()])


def follow_phase(samples: Samples, highest: int, slip: float) -> tuple[Samples, Floats]:
    """The samples at the phase that the motion has, and what the frequency is of the stated one at each.

    The frequency is first searched up to `slip`; then the phase of the strongest order is followed from period to
    period, as far as it changes slowly.
    """
    tau, rate = samples.tau, np.ones(len(samples.tau))
    shift = find_shift(fit_periods(samples, highest), slip)
    tau, rate = tau * (1.0 + shift), rate * (1.0 + shift)
    for _ in range(PASSES):
        now = Samples(tau, samples.values / rate**samples.power, samples.power)
        fits = fit_periods(now, highest)
        size = np.abs(np.where(fits.fitted[:, None], fits.waves, 0.0))
        leader = int(np.median(size, axis=0).argmax())
        usual = float(np.median(size[:, leader]))
        alike = (size[:, leader] < ALIKE * usual) & (size[:, leader] > usual / ALIKE)
        if alike.sum() < MOST * len(alike):
            break
        angle = np.zeros(len(size))
        angle[alike] = np.unwrap(np.angle(fits.waves[alike, leader])) / fits.orders[leader]
        ahead = find_pattern(angle, alike, FAR_PHASE).slow
        number = tau / TURN - 0.5
        faster = 1.0 + ahead.deriv()(number) / TURN
        if np.abs(faster - 1.0).max() > FASTER:
            break
        tau = tau + ahead(number) - ahead(number[0])
        rate = rate * faster
        if np.abs(ahead(number) - ahead(number[0])).max() < EXACT:
            break
    return Samples(tau, samples.values / rate**samples.power, samples.power), rate
