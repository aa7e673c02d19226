"""A measured drive: the orders of the driver's motion and the intensity of its noise, from a table of samples.

The samples are cut into whole periods.  Each period has its Fourier coefficients; those of the acceleration follow
from a displacement or a speed by ``c_j(x') = i j omega c_j(x) + (x(end) - x(start)) / T``, which holds for motion that
is not periodic.  Their mean is the drive.  What the acceleration of a period is of the mean one,

``p_k = 1 + (integral of m f''^2) / (integral of f''^2)``  with the modulation ``m`` of docs/model.md section 4,

scatters with the variance ``S (integral of f''^4) / (integral of f''^2)^2`` where m is white noise of the spectral
density ``S = (sigma / alpha)^2``: so the scatter of the periods gives sigma.
"""

import csv
import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rattle.scene.errors import InputError, count, positive
from rattle.scene.files import read_text
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.parts import Order
from rattle.scene.types import Floats

if TYPE_CHECKING:
    from rattle.scene.plot import ShownFigure


ALONG = {"time": {"s": 1.0, "ms": 1e-3}, "angle": {"rad": 1.0, "deg": math.pi / 180.0, "°": math.pi / 180.0}}
RPM = 2.0 * math.pi / 60.0
VALUES = {
    "displacement": {"rad": 1.0, "deg": math.pi / 180.0, "mm": 1.0},
    "speed": {"rad/s": 1.0, "rpm": RPM, "1/min": RPM, "mm/s": 1.0},
    "acceleration": {"rad/s^2": 1.0, "rad/s2": 1.0, "rad/s²": 1.0, "mm/s^2": 1.0, "mm/s2": 1.0, "mm/s²": 1.0},
}
"""What a column may hold, by its first word, and the factor of each unit to s, rad or mm."""
HEADER = re.compile(r"(?:crank )?(\w+)\s*[\[(]\s*([^\])]+?)\s*[\])]", flags=re.I)
JITTER = 0.02  # of a step, by which times may be rounded
LEAST_PERIODS, LEAST_SAMPLES = 8, 16
SLIP = 0.02  # share by which the frequency in the file may differ from the stated one
ZOOMS = 4  # refinements of the frequency
FUNDAMENTALS = 4  # orders by which the frequency is found
HIGHEST = 16  # order that is looked for by default
SMALL = 0.01  # of the largest acceleration of an order, below which an order is left out
CHANCE = 4.0  # standard errors up to which an order is left out
REMEMBERS = 3.0  # standard errors of the correlation of successive periods from which on the noise is said to remember
STEADY = 5.0  # mean over sd of a speed from which on it is that of the rotation, not its fluctuation


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
        Noise intensity ``sigma / alpha`` of white noise with the scatter of the periods, with its 95 % interval.
    memory : float
        Correlation of the modulation of successive periods: about 0 for white noise.
    left_out : float
        Root mean square acceleration of what is left out of the mean period, over that of the mean period.
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
    """

    drive: tuple[Order, ...]
    amplitude: float
    omega: float
    periods: int
    sigma_ratio: float
    low: float
    high: float
    memory: float
    left_out: float
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
        said = [
            f"{self.periods} periods at {self.omega:.5g} rad/s: {', '.join(named)}; what is left out has "
            f"{100.0 * self.left_out:.2g} % of the rms acceleration.",
            f"The scatter of the periods is that of white noise of sigma = {self.sigma_ratio:.3g} alpha (95 % interval "
            f"{self.low:.3g} to {self.high:.3g} alpha); noise of the measurement counts as noise of the drive.",
        ]
        if self.memory > REMEMBERS / math.sqrt(self.periods):
            said.append(
                f"Successive periods correlate by {self.memory:.2f}: the noise has a memory (correlation_time), and "
                "sigma is that of white noise which scatters as much, not that of its own spectrum."
            )
        return said

    def plot(self) -> "ShownFigure":
        """Draw the mean period beside the orders, with the scatter of the periods and what is left out.

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
    highest_order: int = HIGHEST,
) -> MeasuredDrive:
    """Turn a measured motion of the driver into orders and a noise intensity.

    Parameters
    ----------
    file : path or str
        A CSV file (comma, semicolon or tab), or its text.  Its first line names two columns with their units:
        ``time`` in s or ms, or the crank ``angle`` in deg or rad; and the driver's ``displacement`` (rad, deg, mm),
        ``speed`` (rad/s, rpm, mm/s) or ``acceleration`` (rad/s^2, mm/s^2), as in ``time [ms], speed [rpm]``.
    omega : float, optional
        Frequency of the drive in rad/s; it is found to a fraction of 2 % around it.  May be left out where `periods` is
        given, or where the file has the speed of the rotation over the angle.
    driver_radius : float, optional
        Base radius of the driver in mm, for a motion in rad.
    periods : int, optional
        How many whole periods of the drive the file has, from its first sample to one step after its last.
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
        For a file that cannot be read, with the line: no such columns or units, gaps, unequal steps, what is no number,
        too few periods or samples, a frequency that is not in it.

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
    text = str(file) if "\n" in str(file) else read_text("drive.file", file, "a CSV file")
    (along, step), (quantity, unit), x, y = _read_columns(text)
    if unit.startswith(("rad", "deg", "rpm", "1/min", "°")):
        if driver_radius is None:
            raise InputError("gears.driver_radius", None, f"give it, in mm, for a drive in {unit}")
        y = y * positive("gears.driver_radius", driver_radius)
    x, y = x * step, y * VALUES[quantity][unit]
    if along == "angle":
        turning = y / (driver_radius or 1.0) if quantity == "speed" else np.zeros_like(y)
        x, omega = _time_of_angle(x, turning, omega, count("drive.periods_per_turn", periods_per_turn))
    if periods is not None:
        stated = 2.0 * math.pi * count("drive.periods", periods) / (len(x) * (x[1] - x[0]))
        if omega is not None and abs(stated / omega - 1.0) > SLIP:
            why = f"would be a frequency of {stated:.5g} rad/s, not the {omega:.5g} of the gears"
            raise InputError("drive.periods", periods, why)
        omega = stated
    if omega is None:
        why = "give the frequency of the drive in rad/s, or drive.periods: how many the file has"
        raise InputError("gears.omega", None, why)
    if periods is None:
        omega = _find_frequency(x, y, omega)
    return _analyse(x, y, omega, quantity, unit, count("drive.highest_order", highest_order), driver_radius)


def _read_columns(text: str) -> tuple[tuple[str, float], tuple[str, str], Floats, Floats]:
    """What runs along with its factor, what was measured with its unit, and both columns."""
    lines = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip() and not line.startswith("#")]
    if not lines:
        raise InputError("drive.file", text, "is empty; give a CSV file with two columns")
    head = lines[0][1]
    mark = next((m for m in (";", "\t") if m in head), ",")
    names = [cell.strip() for cell in head.split(mark)]
    found = [HEADER.fullmatch(name) for name in names]
    if len(names) != 2 or None in found:
        why = "name two columns with their units in its first line, as in: time [ms], speed [rpm]"
        raise InputError("drive.file", head, why)
    (along, step), (quantity, unit) = ((m[1].lower(), m[2]) for m in found if m)
    for name, given, known in ((along, step, ALONG), (quantity, unit, VALUES)):
        if name not in known:
            raise InputError("drive.file", name, f"is no such column; give {' or '.join(known)}")
        if given not in known[name]:
            raise InputError("drive.file", f"{name} [{given}]", f"has an unknown unit; give {', '.join(known[name])}")
    rows = []
    for (number, _), cells in zip(lines[1:], csv.reader((line for _, line in lines[1:]), delimiter=mark), strict=True):
        try:
            pair = [float(cell) for cell in cells]
        except ValueError:
            pair = [math.nan]
        if len(pair) != 2 or not all(map(math.isfinite, pair)):
            why = "needs two numbers, with decimal points; leave out the rows before or after a gap"
            raise InputError(f"drive.file, line {number}", mark.join(cells), why)
        rows.append((number, *pair))
    if len(rows) < LEAST_PERIODS * LEAST_SAMPLES:
        why = f"is too short: {LEAST_PERIODS} periods of {LEAST_SAMPLES} samples are the least"
        raise InputError("drive.file", f"{len(rows)} samples", why)
    numbers, x, y = (np.array(column) for column in zip(*rows, strict=True))
    if along == "angle":
        x = np.unwrap(x, period=2.0 * math.pi / ALONG[along][step])
    _check_steps(x, numbers, along)
    return (along, ALONG[along][step]), (quantity, unit), np.linspace(x[0], x[-1], len(x)), y


def _check_steps(x: Floats, numbers: Floats, along: str) -> None:
    """Refuse a column that does not rise by equal steps."""
    rise = np.diff(x)
    usual = float(np.median(rise))
    if not usual > 0.0:
        raise InputError("drive.file", along, "must rise from row to row")
    off = np.abs(rise / usual - 1.0)
    k = int(off.argmax())
    if off[k] <= 2.0 * JITTER:
        return
    where, jump = f"drive.file, line {int(numbers[k + 1])}", float(rise[k])
    why = f"has another step than the others, {jump:g} where {usual:g} is usual"
    if jump > 1.5 * usual:
        why = f"follows a gap of {jump / usual:.3g} steps; give a part of the file without gaps"
    raise InputError(where, f"{along} = {x[k + 1]:g}", why)


def _time_of_angle(angle: Floats, speed: Floats, omega: float | None, per_turn: int) -> tuple[Floats, float]:
    """The time of each sample, for an angle of the driver, and the frequency of the drive.

    `speed`: In rad/s; that of the rotation where its mean is far from 0.
    """
    if float(speed.mean()) > STEADY * float(speed.std()):
        slow = 1.0 / speed
        time = np.concatenate([[0.0], np.cumsum(0.5 * (slow[1:] + slow[:-1]) * np.diff(angle))])
        own = per_turn * float(angle[-1] - angle[0]) / float(time[-1])
        if omega is not None and abs(own / omega - 1.0) > SLIP:
            why = f"but the file turns at {own / per_turn:.5g} rad/s, with {per_turn} periods in a turn"
            raise InputError("gears.omega", omega, why)
        return time, own
    if omega is None:
        why = "give the frequency of the drive in rad/s: the file has no speed of rotation"
        raise InputError("gears.omega", None, why)
    return angle * per_turn / omega, omega


def _find_frequency(x: Floats, y: Floats, omega: float) -> float:
    """The frequency near a stated one at which the first orders of all periods add up to most."""
    start, half = omega, SLIP
    for _ in range(ZOOMS):
        shares = np.linspace(-half, half, 401)
        cycles, _ = _cut(x, y, omega)
        c = np.fft.rfft(cycles - cycles.mean(axis=1, keepdims=True), axis=1)[:, 1 : 1 + FUNDAMENTALS]
        turn = 2.0 * math.pi * np.arange(len(c))[:, None] * np.arange(1, 1 + c.shape[1])
        power = [(np.abs((c * np.exp(-1j * share * turn)).sum(axis=0)) ** 2).sum() for share in shares]
        best = int(np.argmax(power))
        if half == SLIP and best in (0, len(shares) - 1):
            break
        omega, half = omega * (1.0 + float(shares[best])), 0.05 * half
    else:
        return omega
    raise InputError("gears.omega", start, f"is not in the file: its motion does not repeat within {SLIP:.0%} of it")


def _cut(x: Floats, y: Floats, omega: float) -> tuple[Floats, Any]:
    """Whole periods, each at as many equal times from its start on, shape (periods, samples), and a spline of all."""
    from scipy.interpolate import CubicSpline

    period = 2.0 * math.pi / omega
    total = x[-1] - x[0] + (x[-1] - x[0]) / (len(x) - 1)
    each = len(x) * period / total
    whole = int((x[-1] - x[0]) / period + 1e-6)
    if whole < LEAST_PERIODS:
        why = f"is too short; {LEAST_PERIODS} periods are the least"
        raise InputError("drive.file", f"{total / period:.3g} periods", why)
    if each < LEAST_SAMPLES:
        raise InputError("drive.file", f"{each:.3g} samples a period", f"is too coarse; {LEAST_SAMPLES} are the least")
    samples = 1 << math.ceil(math.log2(each))
    spline = CubicSpline(x, y)
    times = x[0] + period * (np.arange(whole)[:, None] + np.arange(samples + 1) / samples)
    return spline(times[:, :-1]), spline


def _analyse(
    x: Floats, y: Floats, omega: float, quantity: str, unit: str, highest: int, radius: float | None
) -> MeasuredDrive:
    """Orders and noise from samples in mm, mm/s or mm/s^2 at equal times."""
    from scipy.stats import chi2

    cycles, spline = _cut(x, y, omega)
    periods, samples = cycles.shape
    highest = min(highest, samples // 4)
    orders = np.arange(1, samples // 2)
    c = np.fft.rfft(cycles, axis=1)[:, 1 : samples // 2] / samples
    edges = x[0] + 2.0 * math.pi / omega * np.arange(periods + 1)
    power = list(VALUES).index(quantity)  # how often a displacement is differentiated
    for degree in range(2 - power):
        jump = np.diff(spline(edges, degree)) * omega / (2.0 * math.pi)
        c = 1j * omega * orders * c + jump[:, None]
    mean = c.mean(axis=0)
    error = np.sqrt((np.abs(c - mean) ** 2).sum(axis=0) / (periods - 1) / periods / 2.0)
    size = np.abs(mean)
    looked = orders <= highest
    kept = looked & (size > SMALL * size.max()) & (size > CHANCE * error)
    if not kept.any():
        raise InputError("gears.omega", omega, "is not in the file: no order of it is larger than its error")
    displacement = -mean / (omega * orders) ** 2
    sizes, phase = 2.0 * np.abs(displacement), np.angle(displacement) + 0.5 * math.pi
    amplitude = float(sizes[kept].max())
    drive = tuple(
        Order(int(j), float(a / amplitude), float(math.remainder(p, 2.0 * math.pi)))
        for j, a, p in zip(orders[kept], sizes[kept], phase[kept], strict=True)
    )
    share = np.real((c[:, kept] * np.conj(mean[kept])).sum(axis=1)) / (size[kept] ** 2).sum()
    tau = 2.0 * math.pi * np.arange(16 * samples) / (16 * samples)
    second = 2.0 * np.real(mean[kept] @ np.exp(1j * np.outer(orders[kept], tau)))
    density = share.var(ddof=1) * 2.0 * math.pi * (second**2).mean() ** 2 / (second**4).mean()
    low, high = (math.sqrt(density * (periods - 1) / chi2.ppf(q, periods - 1)) for q in (0.975, 0.025))
    rest = share - share.mean()
    memory = float((rest[1:] * rest[:-1]).sum() / max((rest**2).sum(), 1e-300))
    factor = VALUES[quantity][unit] * (radius or 1.0 if not unit.startswith("mm") else 1.0)
    own = cycles - cycles.mean(axis=1, keepdims=True)
    times = np.exp(1j * np.outer(orders[kept], 2.0 * math.pi * np.arange(samples) / samples))
    summed = 2.0 * np.real((displacement[kept] * (1j * omega * orders[kept]) ** power) @ times)
    left_out = float(np.sqrt((size[~kept] ** 2).sum() / (size**2).sum()))
    table = {
        "order": orders[looked].tolist(),
        "amplitude_mm": sizes[looked].tolist(),
        "phase": [math.remainder(p, 2.0 * math.pi) for p in phase[looked]],
        "se_mm": (2.0 * error / (omega * orders) ** 2)[looked].tolist(),
        "kept": kept[looked].tolist(),
    }
    found = drive, amplitude, omega, periods, math.sqrt(density), low, high, memory, left_out, table, quantity, unit
    return MeasuredDrive(*found, own.mean(axis=0) / factor, own.std(axis=0, ddof=1) / factor, summed / factor)
