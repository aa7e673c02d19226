"""A measured drive: the orders of the driver's motion and the intensity of its noise, from a table
of samples.

The file (`rattle.scene.measured_file`) is brought to the phase of the drive
(`rattle.scene.drive_phase`), the orders of each period are fitted there
(`rattle.scene.period_fits`), their mean is the drive, and their scatter gives the noise
(`rattle.scene.drive_noise`).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rattle.scene.drive_noise import (
    RESOLUTION,
    Pattern,
    correlate_neighbours,
    estimate_noise,
    find_pattern,
)
from rattle.scene.drive_phase import SLIP, Followed, follow, guess_phases, is_spike
from rattle.scene.errors import InputError, count, positive
from rattle.scene.measured_file import RPM, Measurement, read_measurement
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.parts import Order
from rattle.scene.period_fits import (
    FULL_TURN,
    PeriodFits,
    Samples,
    Waves,
    evaluate,
    fit_periods,
    measure_gains,
    measure_own_noise,
    project,
)
from rattle.scene.text import percent
from rattle.scene.types import Bools, Floats

if TYPE_CHECKING:
    from rattle.scene.plot import ShownFigure


HIGHEST_ORDER = 16  # order that is looked for by default
SMALL_ORDER = 0.01  # of the largest acceleration of an order, below which an order is left out
CHANCE = 4.0  # standard errors up to which an order is left out
# share of the power of all periods that their mean has, below which the drive is not in the file
COHERENT = 0.25
REMEMBERS = 3.0  # standard errors of the correlation of successive periods from which on it is said
FAR_OFF = 0.001  # of the mean period, up to which no period counts as far off
DRIFTS = 0.002  # relative range of the frequency, or of the amplitude, from which on it is said
CLEARLY = 0.5  # of the scatter over time, below which the orders follow the angle
OFF = 0.1  # periods by which a stated number of periods may be off
VANISHING = 1e-4  # share that is not written
LINES_NAMED = 5  # lines that are named


@numpy_defaults
@dataclass(frozen=True)
class MeasuredDrive:
    """The orders and the noise of a measured drive, from `measure_drive`.

    Attributes
    ----------
    drive : tuple of Order
        For a scene: relative to the largest order, phases at the first sample.
    amplitude : float
        Amplitude of the largest order on the driver's pitch circle, in mm.
    omega : float
        Frequency of the drive in rad/s, as found in the file.
    periods : int
        Whole periods that were averaged.
    sigma_ratio, low, high : float
        Noise intensity ``sigma / alpha`` of white noise with the scatter of the periods, with its
        95 % interval; ``low`` is 0 where the file does not show any.
    floor : float
        The ``sigma / alpha`` for which the noise of the measurement alone would be taken; it is
        subtracted.
    memory : float
        Correlation of the modulation of successive periods: about 0 for white noise.
    left_out : float
        Root mean square acceleration of what is left out, half orders included, over that of the
        motion.
    remarks : tuple of str
        What else was found: bad samples, periods left out, a drift, half orders.
    table : dict
        Columns ``order, amplitude_mm, phase, se_mm, kept`` of every order that was looked for.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(2000) / 5000.0
    >>> rows = "".join(f"{a:.6f},{0.3 * np.sin(300.0 * a):.9f}\\n" for a in t)
    >>> found = measure_drive("time [s],displacement [mm]\\n" + rows, omega=300.0)
    >>> found.periods, round(found.amplitude, 6), [one.order for one in found.drive]
    (19, 0.3, [1])
    >>> found.answer[1]
    'The periods show no noise of the drive: sigma is at most 1e-05 alpha.'
    """

    drive: tuple[Order, ...]
    amplitude: float
    omega: float
    periods: int
    sigma_ratio: float
    low: float
    high: float
    floor: float
    memory: float
    left_out: float
    remarks: tuple[str, ...]
    table: dict[str, list[Any]] = field(repr=False)
    quantity: str  # what was measured: displacement, speed or acceleration
    unit: str
    cycle: Floats = field(repr=False)  # the mean period of it, less its mean; (samples,)
    spread: Floats = field(repr=False)  # sd of the periods
    sum_of_orders: Floats = field(repr=False)

    @property
    def answer(self) -> list[str]:
        """What was found, in sentences."""
        named = [f"order {one.order} {self.amplitude * one.amplitude:.3g} mm" for one in self.drive]
        rest = (
            percent(self.left_out)
            if self.left_out > VANISHING
            else f"less than {percent(VANISHING)}"
        )
        sentences = [
            f"{self.periods} periods at {self.omega:.5g} rad/s: {', '.join(named)}; what is left"
            f" out has {rest} of the rms acceleration."
        ]
        own = ""
        if self.floor > RESOLUTION:
            own = (
                f"; white noise of the measurement, which alone looks like {self.floor:.2g} alpha,"
                " is subtracted"
            )
        if self.low > 0.0:
            sentences.append(
                "The scatter of the periods is that of white noise of sigma ="
                f" {self.sigma_ratio:.3g} alpha (95 % interval {self.low:.3g} to {self.high:.3g}"
                f" alpha){own}."
            )
        else:
            sentences.append(
                f"The periods show no noise of the drive: sigma is at most {self.high:.3g}"
                f" alpha{own}."
            )
        sentences += self.remarks
        if self.low > 0.0 and abs(self.memory) > REMEMBERS / math.sqrt(self.periods):
            why = (
                "the noise has a memory (correlation_time)"
                if self.memory > 0.0
                else "something alternates"
            )
            sentences.append(
                f"Successive periods correlate by {self.memory:.2f}: {why}, and sigma is that of"
                " white noise which scatters as much, not that of its own spectrum."
            )
        return sentences

    def plot(self) -> "ShownFigure":
        """Draw the mean period beside the orders, with the scatter of the periods and what is left
        out.

        Returns
        -------
        Figure
            Of matplotlib; a notebook shows it, ``savefig`` writes it.
        """
        from rattle.scene.plot import plot_drive

        what = f"{self.quantity} in {self.unit}"
        return plot_drive(self.cycle, self.spread, self.sum_of_orders, self.table, what)


@numpy_defaults
def measure_drive(
    file: str | Path,
    *,
    omega: float | None = None,
    driver_radius: float | None = None,
    periods: int | None = None,
    periods_per_turn: int = 1,
    highest_order: int = HIGHEST_ORDER,
) -> MeasuredDrive:
    """Turn a measured motion of the driver into orders and a noise intensity.

    Parameters
    ----------
    file : path or str
        A CSV file (comma, semicolon or tab), or its text.  Its first line names two columns with
        their units: ``time`` in s or ms, or the crank ``angle`` in deg or rad; and the driver's
        ``displacement`` (rad, deg, mm), ``speed`` (rad/s, rpm, deg/s, mm/s) or ``acceleration``
        (rad/s^2, mm/s^2), as in ``time [ms], speed [rpm]``. Steps may be uneven; an angle may be
        wrapped.
    omega : float, optional
        Frequency of the drive in rad/s; it is found to a fraction of 2 % around it.  May be left
        out where `periods` is given, or where the file has the speed of the rotation over the
        angle.
    driver_radius : float, optional
        Base radius of the driver in mm, for a motion in rad.
    periods : int, optional
        How many whole periods of the drive the file has, from its first sample to one step after
        its last.
    periods_per_turn : int
        Over an angle: how often the drive repeats in a turn of the driver.
    highest_order : int
        Up to which orders are looked for.

    Returns
    -------
    MeasuredDrive

    Raises
    ------
    InputError
        For a file that cannot be read, with the line: no such columns or units, gaps, times that do
        not rise, what is no number, too few periods or samples, a frequency that is not in it.

    Notes
    -----
    Samples and periods that stand far off the others are left out, by medians, and named in
    ``answer``; so are orders between whole ones, a slow change of the frequency or of the
    amplitude, and a number of periods that is wrong.

    Examples
    --------
    >>> import numpy as np
    >>> angle = np.arange(0.0, 360.0 * 20, 2.0)
    >>> speed = 800.0 + 20.0 * np.sin(np.radians(2.0 * angle))
    >>> text = "angle [deg],speed [rpm]\\n" + "".join(f"{a},{v}\\n" for a, v in zip(angle, speed))
    >>> found = measure_drive(text, driver_radius=32.0, periods_per_turn=2)
    >>> round(found.omega, 1), round(found.amplitude, 2)
    (167.5, 0.4)
    """
    measured = read_measurement(file)
    radius = _read_radius(measured, driver_radius)
    highest = count("drive.highest_order", highest_order)
    per_turn = count("drive.periods_per_turn", periods_per_turn)
    good = ~is_spike(measured.values)
    phases = guess_phases(measured, good, omega, periods, per_turn, driver_radius)
    slip = SLIP if periods is None else max(SLIP, 1.0 / periods)
    best, *others = [follow(measured, good, guess, radius, highest, slip) for guess in phases]
    for other in others:
        if other.scatter < CLEARLY * best.scatter:
            best = other
    if best.coherence < COHERENT or (len(phases) == 1 and abs(best.shift) > 1.05 * slip):
        name, value = ("gears.omega", omega) if periods is None else ("drive.periods", periods)
        why = f"is not in the file: its motion does not repeat within {percent(slip)} of it"
        raise InputError(name, value, why)
    return _analyse(measured, best, highest, radius, periods, per_turn)


def _read_radius(measured: Measurement, driver_radius: float | None) -> float:
    """The radius in mm that makes the motion one of the pitch circle; 1 where it is one already."""
    if not measured.is_angular:
        return 1.0
    if driver_radius is None:
        why = f"give it, in mm, for a drive in {measured.unit}"
        raise InputError("gears.driver_radius", None, why)
    return positive("gears.driver_radius", driver_radius)


def _analyse(
    measured: Measurement,
    found: Followed,
    highest: int,
    radius: float,
    stated: int | None,
    per_turn: int,
) -> MeasuredDrive:
    """Orders and noise from samples at the phase of the drive."""
    samples = found.samples
    fits = found.fits
    good, cycle = _find_good_periods(fits, found.mean)
    between = _fit_between(samples, len(fits.orders), cycle)
    if cycle > 1:
        subharmonic = between[1] / (1j * between[0]) ** (2 - samples.power)
        samples = replace(
            samples, values=samples.values - evaluate(between[0], subharmonic, samples.tau)
        )
        fits = fit_periods(samples, len(fits.orders))
    orders = fits.orders
    waves = fits.filled
    mean, error = _average(waves[good])
    size = np.abs(mean)
    kept = (orders <= highest) & (size > SMALL_ORDER * size.max()) & (size > CHANCE * error)
    if not kept.any():
        raise InputError(
            "gears.omega",
            found.omega,
            "is not in the file: no order of it is larger than its error",
        )
    drive = np.where(kept, mean, 0.0)
    pattern = find_pattern(project(waves, drive).real, good, math.inf, cycles=(cycle,))
    gains = measure_gains(samples, len(orders), drive)
    sigma, low, high, floor = estimate_noise(
        pattern, gains, measure_own_noise(samples, orders, mean)
    )

    within = orders, mean, error, kept
    every, waves_of_all, errors, used = (
        np.concatenate(pair) for pair in zip(within, between, strict=True)
    )
    table = _tabulate(every, waves_of_all, errors, used, highest)
    amplitude = max(a for a, k in zip(table["amplitude_mm"], table["kept"], strict=True) if k)
    rows = zip(*(table[name] for name in ("order", "amplitude_mm", "phase", "kept")), strict=True)
    made = tuple(Order(int(order), a / amplitude, phase) for order, a, phase, k in rows if k)

    each = len(samples.tau) // len(waves)
    tau = FULL_TURN * np.arange(each) / each
    unit = found.omega**samples.power / (measured.factor * radius)
    derive = np.asarray(unit * (1j * orders) ** (samples.power - 2), np.complex128)
    cycles = np.real((derive * waves[good]) @ np.exp(1j * np.outer(orders, tau)))
    return MeasuredDrive(
        drive=made,
        amplitude=amplitude,
        omega=found.omega,
        periods=int(good.sum()),
        sigma_ratio=sigma,
        low=low,
        high=high,
        floor=floor,
        memory=correlate_neighbours(pattern),
        left_out=_measure_rest(waves_of_all, errors, used),
        remarks=tuple(_remark(measured, found, pattern, table, cycle, stated, per_turn)),
        table=table,
        quantity=measured.quantity,
        unit=measured.unit,
        cycle=cycles.mean(axis=0),
        spread=cycles.std(axis=0, ddof=1),
        sum_of_orders=evaluate(orders, derive * drive, tau),
    )


def _find_good_periods(fits: PeriodFits, mean: Waves) -> tuple[Bools, int]:
    """Which periods do not stand far off the others, and after how many the motion repeats."""
    large = np.abs(mean) > SMALL_ORDER * np.abs(mean).max()
    shares = project(fits.filled[:, large], mean[large])
    along = find_pattern(shares.real, fits.fitted, FAR_OFF)
    across = find_pattern(shares.imag, along.good, FAR_OFF)
    return across.good, max(along.cycle, across.cycle)


def _average(waves: Waves) -> tuple[Waves, Floats]:
    """The mean of the periods, and the standard error of its real and imaginary parts."""
    number = len(waves)
    mean = waves.mean(axis=0)
    return mean, np.sqrt((np.abs(waves - mean) ** 2).sum(axis=0) / (number - 1) / number / 2.0)


def _fit_between(samples: Samples, highest: int, cycle: int) -> tuple[Floats, Waves, Floats, Bools]:
    """Orders that are no whole numbers, of a motion that repeats after `cycle` periods; none of
    them is kept."""
    fits = fit_periods(samples, highest if cycle > 1 else 1, cycle)
    between = fits.orders % 1.0 > 0.0
    mean, error = _average(fits.waves[fits.fitted][:, between])
    return fits.orders[between], mean, error, np.zeros(len(mean), bool)


def _measure_rest(mean: Waves, error: Floats, kept: Bools) -> float:
    """Root mean square of what is not kept over that of all, with the noise of the mean taken
    off."""
    rest = max(float((np.abs(mean) ** 2 - 2.0 * error**2)[~kept].sum()), 0.0)
    return math.sqrt(rest / (rest + float((np.abs(mean[kept]) ** 2).sum())))


def _tabulate(
    orders: Floats, mean: Waves, error: Floats, kept: Bools, highest: int
) -> dict[str, list[Any]]:
    """The orders up to the highest, as a motion in mm."""
    rows = np.argsort(orders)
    rows = rows[orders[rows] <= highest]
    displacement = -mean / orders**2
    numbers = orders[rows].tolist()
    phases = np.angle(displacement[rows]) + 0.5 * math.pi
    return {
        "order": [int(order) if order.is_integer() else order for order in numbers],
        "amplitude_mm": np.abs(displacement[rows]).tolist(),
        "phase": [math.remainder(phase, FULL_TURN) for phase in phases],
        "se_mm": (error / orders**2)[rows].tolist(),
        "kept": kept[rows].tolist(),
    }


def _remark(
    measured: Measurement,
    found: Followed,
    pattern: Pattern,
    table: dict[str, list[Any]],
    cycle: int,
    stated: int | None,
    per_turn: int,
) -> Iterator[str]:
    """What else was found, in sentences."""
    bad = [f"{measured.lines[k]} ({measured.written[k]:g})" for k in np.flatnonzero(~found.good)]
    if bad:
        yield f"Left out as bad, far off their neighbours: the samples of line {_name_few(bad)}."
    off = np.flatnonzero(~pattern.good)
    if len(off):
        lines = measured.lines[found.good]
        edges = np.searchsorted(found.samples.tau, FULL_TURN * np.stack([off, off + 1])) - np.array(
            [[0], [1]]
        )
        named = _name_few([f"{lines[first]} to {lines[last]}" for first, last in edges.T])
        many = f"{len(off)} of {len(pattern.good)} periods"
        yield f"{many} are left out, far off the others: line {named}."
    if stated is not None and abs(found.length - stated) > OFF:
        yield f"The file has {found.length:.4g} periods, not the {stated} that were stated."
    yield from _remark_drift(measured, found, pattern, per_turn)
    rows = zip(table["order"], table["amplitude_mm"], table["se_mm"], strict=True)
    between = [(order, a) for order, a, se in rows if order % 1.0 > 0.0 and a > CHANCE * se]
    if between:
        largest = sorted(between, key=itemgetter(1), reverse=True)[:LINES_NAMED]
        largest = [(order, a) for order, a in largest if a > SMALL_ORDER * largest[0][1]]
        parts = ", ".join(f"order {order:.3g} {a:.2g} mm" for order, a in sorted(largest))
        yield (
            f"The motion repeats only after {cycle} periods: {parts} count as left out, not as"
            " noise."
        )


def _name_few(names: list[str]) -> str:
    """The first of some names, and how many more there are."""
    more = len(names) - LINES_NAMED
    return ", ".join(names[:LINES_NAMED]) + (f" and {more} more" if more > 0 else "")


def _remark_drift(
    measured: Measurement, found: Followed, pattern: Pattern, per_turn: int
) -> Iterator[str]:
    """A frequency or an amplitude that changes slowly."""
    slowest = float(found.rate.min())
    fastest = float(found.rate.max())
    if fastest > (1.0 + DRIFTS) * slowest:
        speed = ""
        if measured.along == "angle":
            speed = (
                f" (the mean speed from {slowest / per_turn / RPM:.4g} to"
                f" {fastest / per_turn / RPM:.4g} rpm)"
            )
        yield (
            f"The frequency runs from {slowest:.4g} to {fastest:.4g} rad/s{speed}: the orders"
            " follow its phase, and this is no noise."
        )
    share = pattern.slow(np.flatnonzero(pattern.good))
    if np.ptp(share) > DRIFTS:
        yield (
            f"The motion runs from {percent(share.min(), 3)} to {percent(share.max(), 3)} of its"
            " mean: a slow change is no noise; vary alpha for it."
        )
