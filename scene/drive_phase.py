"""The phase of the drive at each sample of a measured motion, with bad samples left out."""

import math
from dataclasses import dataclass, replace

import numpy as np

from rattle.scene.drive_noise import find_pattern
from rattle.scene.errors import InputError, count, positive
from rattle.scene.measured_file import Measurement
from rattle.scene.period_fits import (
    FULL_TURN,
    PeriodFits,
    Samples,
    Waves,
    count_periods,
    evaluate,
    fit_periods,
)
from rattle.scene.types import Bools, Floats

LEAST_PERIODS = 8
LEAST_SAMPLES = 16
LONGEST_STEP = FULL_TURN / 8.0  # of the phase, between two samples
LEAST_SPIKE = 0.003  # of the range of the mean period, up to which no sample stands out from it
SLIP = 0.02  # share by which the frequency in the file may differ from the stated one
STRONGEST_ORDERS = 4  # orders by which the frequency is found
PHASE_PASSES = 6  # of the phase: each shrinks its error by more than ten times
NEIGHBOURS = 11  # samples whose median a sample is compared with: five bad ones in a row are seen
SPIKE = 10.0  # times the usual step from sample to sample, beyond which a sample is bad
USUAL = 0.9  # quantile of the steps
RARE = 0.01  # share of the samples from which on they are no bad ones, but a motion with steps
FAR_PHASE = 0.1  # rad, up to which no period counts as far off
# rad of the strongest order, from which on its phase cannot be followed from period to period
UNSTEADY = 0.6
# share of the periods whose phases are to be compared, for a phase to be followed
SHARE_COMPARED = 0.5
FASTER = 0.3  # relative change of the frequency that is never a slow one of the stated
PHASE_RESOLUTION = 1e-9  # rad, up to which the phase is left as it is
ALIKE_SIZES = 2.0  # factor between the sizes of two periods, up to which their phases are compared


def is_spike(values: Floats, least: float = 0.0) -> Bools:
    """Which samples stand out from their neighbours, far more than samples move from one to the
    next."""
    from scipy.ndimage import median_filter

    off = np.abs(values - median_filter(values, NEIGHBOURS, mode="nearest"))
    step = float(np.quantile(np.abs(np.diff(values)), USUAL))
    spikes = off > max(SPIKE * step, least)
    return np.asarray(spikes & (spikes.mean() <= RARE))


def find_shift(fits: PeriodFits, slip: float) -> float:
    """The change of the frequency, up to a share `slip`, at which the strongest orders of all
    periods add up best."""
    waves = fits.waves[fits.fitted]
    number = np.flatnonzero(fits.fitted)
    size = np.abs(waves)
    length = np.linalg.norm(size, axis=1)
    # no period counts for more than the others
    waves = waves / np.maximum(length, np.median(length))[:, None]
    # of a turn in a period: the direction of a faster one is not known
    usable = fits.orders * slip < 0.4
    strongest = np.argsort(np.where(usable, np.median(size, axis=0), 0.0))[-STRONGEST_ORDERS:]
    shares = np.linspace(
        -slip, slip, 1 + 2 * math.ceil(8.0 * slip * fits.orders[strongest].max() * len(fits.waves))
    )
    power = np.zeros(len(shares))
    for j in strongest:
        turns = np.outer(shares, fits.orders[j] * number)
        power += np.abs(np.exp(-1j * FULL_TURN * turns) @ waves[:, j]) ** 2
    return float(shares[power.argmax()])


def follow_phase(samples: Samples, highest: int, slip: float) -> tuple[Samples, Floats]:
    """The samples at the phase that the motion has, and what the frequency is of the stated one at
    each.

    The frequency is first searched up to `slip`; then the phase of the strongest order is followed
    from period to period, as far as it changes slowly.
    """
    tau = samples.tau
    rate = np.ones(len(samples.tau))
    shift = find_shift(fit_periods(samples, highest), slip)
    tau = tau * (1.0 + shift)
    rate = rate * (1.0 + shift)
    for _ in range(PHASE_PASSES):
        now = Samples(tau, samples.values / rate**samples.power, samples.power)
        fits = fit_periods(now, highest)
        size = np.abs(fits.filled)
        leader = int(np.median(size, axis=0).argmax())
        usual = float(np.median(size[:, leader]))
        alike = (size[:, leader] < ALIKE_SIZES * usual) & (size[:, leader] > usual / ALIKE_SIZES)
        if alike.sum() < SHARE_COMPARED * len(alike):
            break
        angle = np.zeros(len(size))
        angle[alike] = np.unwrap(np.angle(fits.waves[alike, leader])) / fits.orders[leader]
        pattern = find_pattern(angle, alike, FAR_PHASE)
        if fits.orders[leader] * float(pattern.residual[pattern.good].std()) > UNSTEADY:
            break
        ahead = pattern.slow
        number = tau / FULL_TURN - 0.5
        faster = 1.0 + ahead.deriv()(number) / FULL_TURN
        if np.abs(faster - 1.0).max() > FASTER:
            break
        tau = tau + ahead(number) - ahead(number[0])
        rate = rate * faster
        if np.abs(ahead(number) - ahead(number[0])).max() < PHASE_RESOLUTION:
            break
    return Samples(tau, samples.values / rate**samples.power, samples.power), rate


@dataclass(frozen=True)
class Followed:
    """The good samples at the phase of the drive, and how well the periods repeat."""

    samples: Samples
    rate: Floats  # dtau/dt at each, in rad/s
    fits: PeriodFits
    good: Bools  # which samples of the file they are
    shift: float  # relative change of the frequency from the guess

    @property
    def mean(self) -> Waves:
        """Median of the periods' waves, which a few bad periods do not move."""
        waves = self.fits.waves[self.fits.fitted]
        return np.median(waves.real, axis=0) + 1j * np.median(waves.imag, axis=0)

    @property
    def omega(self) -> float:
        """Mean frequency in rad/s."""
        tau = self.samples.tau
        return float((tau[-1] - tau[0]) / np.trapezoid(1.0 / self.rate, tau))

    @property
    def length(self) -> float:
        """Periods from the first sample to one step after the last."""
        tau = self.samples.tau
        return float((tau[-1] + np.median(np.diff(tau))) / FULL_TURN)

    @property
    def scatter(self) -> float:
        """Median power of what the periods are off their mean, over that of the mean."""
        off = np.abs(self.fits.waves[self.fits.fitted] - self.mean) ** 2
        return float(np.median(off.sum(axis=1)) / (np.abs(self.mean) ** 2).sum())

    @property
    def coherence(self) -> float:
        """Share that the mean has of the power of the largest order."""
        largest = int(np.abs(self.mean).argmax())
        power = np.median(np.abs(self.fits.waves[self.fits.fitted, largest]) ** 2)
        return float(np.abs(self.mean[largest]) ** 2 / power)


def guess_phases(
    measured: Measurement,
    good: Bools,
    omega: float | None,
    periods: int | None,
    per_turn: int,
    radius: float | None,
) -> list[tuple[Floats, Floats]]:
    """Phases of the drive at all samples, with their rates in rad/s: as stated, or with the time or
    the angle."""
    at = measured.at
    if measured.along == "angle":
        turning = measured.values if measured.is_angular else measured.values / (radius or 1.0)
        known = measured.quantity == "speed" and (measured.is_angular or radius is not None)
        if known and _check_turning(measured, good, omega):
            return _phases_of_rotation(at, turning, good, omega, per_turn)
        if omega is None:
            why = "give the frequency of the drive in rad/s: the file has no speed of rotation"
            raise InputError("gears.omega", None, why)
        at = at * per_turn / omega
    if periods is not None:
        stated = FULL_TURN * count("drive.periods", periods) / (at[-1] + at[-1] / (len(at) - 1))
        if omega is not None and abs(stated / omega - 1.0) > SLIP:
            why = f"would be a frequency of {stated:.5g} rad/s, not the {omega:.5g} of the gears"
            raise InputError("drive.periods", periods, why)
        omega = stated
    if omega is None:
        why = "give the frequency of the drive in rad/s, or drive.periods: how many the file has"
        raise InputError("gears.omega", None, why)
    omega = positive("gears.omega", omega)
    return [(omega * at, np.full(len(at), omega))]


def _check_turning(measured: Measurement, good: Bools, omega: float | None) -> bool:
    """Whether a speed over the angle is that of the rotation, not its fluctuation."""
    speed = measured.values
    wrong = np.flatnonzero(good & (speed <= 0.0))
    if len(wrong) == 0:
        return True
    k = wrong[0]
    value = f"speed = {speed[k] / measured.factor:g} {measured.unit}"
    why = ""
    if speed[good].max() <= 0.0:
        why = "is negative where the angle rises; turn the sign of one of the columns"
    elif omega is None:
        why = "give omega, since it is no speed of rotation: that has one sign"
    if why:
        raise InputError(f"drive.file, line {measured.lines[k]}", value, why)
    return False


def _phases_of_rotation(
    angle: Floats, speed: Floats, good: Bools, omega: float | None, per_turn: int
) -> list[tuple[Floats, Floats]]:
    """The phase by a constant frequency in time, and that with a whole number of periods in each
    turn."""
    from scipy.interpolate import CubicSpline

    time = CubicSpline(angle[good], 1.0 / speed[good]).antiderivative()(angle)
    time -= time[0]
    own = per_turn * float(angle[-1] - angle[0]) / float(time[-1])
    if omega is not None and abs(own / omega - 1.0) > SLIP:
        why = f"but the file turns at {own / per_turn:.5g} rad/s, with {per_turn} periods in a turn"
        raise InputError("gears.omega", omega, why)
    steady = own * time, np.full(len(time), own)
    starts = np.arange(0.0, per_turn * angle[-1], FULL_TURN)
    if len(starts) < LEAST_PERIODS:
        return [steady]
    phase = CubicSpline(np.interp(starts / per_turn, angle, time), starts)
    return [steady, (phase(time), phase.derivative()(time))]


def follow(
    measured: Measurement,
    good: Bools,
    phase: tuple[Floats, Floats],
    radius: float,
    highest: int,
    slip: float,
) -> Followed:
    """Follow the phase of the drive from a first guess, and leave out samples that stand out from
    the mean period."""
    tau, rate = phase
    _check_sampling(measured, tau)
    everything = Samples(tau, measured.values * radius / rate**measured.power, measured.power)
    most = int(len(tau) / (tau[-1] / FULL_TURN) / 4.0)
    samples, factor = follow_phase(everything.select(good), min(highest, most), slip)
    fits = fit_periods(samples, min(2 * highest, most))
    followed = Followed(samples, rate[good] * factor, fits, good, float(np.mean(factor)) - 1.0)
    wave = followed.mean / (1j * fits.orders) ** (2 - samples.power)
    motion = evaluate(fits.orders, wave, samples.tau)
    fine = ~is_spike(samples.values - motion, LEAST_SPIKE * float(np.ptp(motion)))
    if fine.all():
        return followed
    good = good.copy()
    good[good] = fine
    samples = samples.select(fine)
    fits = fit_periods(samples, len(fits.orders))
    return replace(followed, samples=samples, rate=followed.rate[fine], fits=fits, good=good)


def _check_sampling(measured: Measurement, tau: Floats) -> None:
    """Refuse too few periods, too few samples in one, and gaps."""
    number = count_periods(tau)
    if number < LEAST_PERIODS:
        why = f"is too short; {LEAST_PERIODS} periods are the least"
        raise InputError("drive.file", f"{tau[-1] / FULL_TURN:.3g} periods", why)
    each = FULL_TURN * len(tau) / tau[-1]
    if each < LEAST_SAMPLES:
        raise InputError(
            "drive.file",
            f"{each:.3g} samples a period",
            f"is too coarse; {LEAST_SAMPLES} are the least",
        )
    steps = np.diff(tau)
    k = int(steps.argmax())
    if steps[k] > LONGEST_STEP:
        where = f"drive.file, line {measured.lines[k + 1]}"
        jump = f"follows a gap of {steps[k] / np.median(steps):.3g} steps"
        raise InputError(where, measured.along, f"{jump}; give a part of the file without gaps")
