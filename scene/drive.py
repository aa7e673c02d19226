"""The driver's motion ``f(tau)`` and its derivatives: ``sin tau``, or a sum of orders
(docs/model.md section 1).

Functions take ``Constants.drive`` itself as an argument: its length is known when they are
compiled, and what belongs to the other kind of drive is left out.
"""

import math
from typing import Any

from rattle.scene.compiled import inline, lean, splice
from rattle.scene.damping import Damped

PERIOD = 2.0 * math.pi  # of the motion
# pi / 2 in three parts; multiples of the first two below 2^20 are exact
QUARTER_HIGH = 1.57079632673412561417
QUARTER_MIDDLE = 6.07710050630396597660e-11
QUARTER_LOW = 2.02226624879595063154e-21
QUARTERS = 0.63661977236758134308  # 2 / pi
# polynomials in x^2 of sin x / x^3 and cos x / x^4 (FDLIBM), highest power first
SINES = (
    1.58969099521155010221e-10,
    -2.50507602534068634195e-8,
    2.75573137070700676789e-6,
    -1.98412698298579493134e-4,
    8.33333333332248946124e-3,
    -1.66666666666666324348e-1,
)
COSINES = (
    -1.13596475577881948265e-11,
    2.08757232129817482790e-9,
    -2.75573143513906633035e-7,
    2.48015872894767294178e-5,
    -1.38888888888741095749e-3,
    4.16666666666666019037e-2,
)


@lean
def sine_cosine(tau: float) -> tuple[float, float]:
    """Sine and cosine to rounding, by the same operations on every processor.

    Reduction to a quarter turn and the polynomials of FDLIBM (k_sin.c, k_cos.c).
    """
    turns = math.floor(QUARTERS * tau + 0.5)
    x = tau - turns * QUARTER_HIGH - turns * QUARTER_MIDDLE - turns * QUARTER_LOW
    z = x * x
    sine = SINES[0]
    cosine = COSINES[0]
    for i in range(1, len(SINES)):
        sine = SINES[i] + z * sine
        cosine = COSINES[i] + z * cosine
    sine = x + x * z * sine
    cosine = 1.0 - (0.5 * z - z * z * cosine)
    quadrant = turns & 3
    if quadrant == 0:
        return sine, cosine
    if quadrant == 1:
        return cosine, -sine
    if quadrant == 2:
        return -sine, -cosine
    return -cosine, sine


@inline
def _turn(
    drive: Any, i: int, angle: float, unit: tuple[float, float], last: tuple[float, float]
) -> tuple[float, float]:
    """Sine and cosine of ``j angle`` of order i: those of the order before it, turned by the angle
    `gap` times.

    `unit`, `last`: Sine and cosine of the angle, and of the order before times the angle.
    """
    sine, cosine = last
    if drive.gap[i] == 0:
        return sine_cosine(drive.order[i] * angle)
    for _ in range(drive.gap[i]):
        sine, cosine = sine * unit[1] + cosine * unit[0], cosine * unit[1] - sine * unit[0]
    return sine, cosine


@splice
def _derivatives(drive: Any, tau: float) -> tuple[float, float, float]:
    """``f'``, ``f''`` and ``f'''`` of several orders."""
    first = 0.0
    second = 0.0
    third = 0.0
    unit = sine_cosine(tau)
    at = (0.0, 1.0)
    for i in range(drive.order.size):
        j = drive.order[i]
        at = _turn(drive, i, tau, unit, at)
        slope = j * (drive.odd[i] * at[1] - drive.even[i] * at[0])
        first += slope
        second -= j * j * (drive.odd[i] * at[0] + drive.even[i] * at[1])
        third -= j * j * slope
    return first, second, third


@inline
def velocity(drive: Any, tau: float) -> float:
    """``f'``."""
    return math.cos(tau) if len(drive) == 0 else _derivatives(drive, tau)[0]


@inline
def acceleration(drive: Any, tau: float) -> float:
    """``f''``."""
    return -math.sin(tau) if len(drive) == 0 else _derivatives(drive, tau)[1]


@inline
def jerk(drive: Any, tau: float) -> float:
    """``f'''``."""
    return -math.cos(tau) if len(drive) == 0 else _derivatives(drive, tau)[2]


@inline
def velocity_acceleration(drive: Any, tau: float) -> tuple[float, float]:
    """``f'`` and ``f''``."""
    if len(drive) == 0:
        return math.cos(tau), -math.sin(tau)
    return _derivatives(drive, tau)[:2]


@inline
def phase_of_orders(drive: Any, tau: float) -> tuple[float, float, float, float]:
    """``-f''``, ``f'``, ``-f'''`` and the time; what sine and cosine are for one order."""
    first, second, third = _derivatives(drive, tau)
    return -second, first, -third, tau


@inline
def begin_derivatives(drive: Any, tau: float) -> tuple[float, float, float]:
    """``f'``, ``f''`` and ``f'''``; the next two derivatives by order go into the rows of
    ``drive.waves``."""
    first = 0.0
    second = 0.0
    third = 0.0
    unit = sine_cosine(tau)
    at = (0.0, 1.0)
    for i in range(drive.order.size):
        j = drive.order[i]
        at = _turn(drive, i, tau, unit, at)
        slope = j * (drive.odd[i] * at[1] - drive.even[i] * at[0])
        bend = -j * j * (drive.odd[i] * at[0] + drive.even[i] * at[1])
        square = -j * j
        first += slope
        second += bend
        third += square * slope
        drive.waves[0, i] = square * bend
        drive.waves[1, i] = square * (square * slope)
    return first, second, third


@inline
def next_derivative(drive: Any, k: int) -> float:
    """Derivative ``k + 3`` of f, for k = 1, 2, ... in turn after `begin_derivatives`."""
    total = 0.0
    row = drive.waves[(k - 1) & 1]
    for i in range(drive.order.size):
        part = row[i]
        total += part
        row[i] = -(drive.order[i] * drive.order[i]) * part
    return total


@inline
def highest_order(drive: Any) -> float:
    """The largest order."""
    return 1.0 if len(drive) == 0 else drive.highest


@inline
def whole_periods(t: float) -> tuple[int, float]:
    """The periods in a time, and what is left of it to rounding."""
    periods = int(t / PERIOD)
    quarters = 4.0 * periods
    rest = t - quarters * QUARTER_HIGH - quarters * QUARTER_MIDDLE - quarters * QUARTER_LOW
    return periods, rest


@inline
def motion_after(drive: Any, tau: float, t: float) -> tuple[float, float]:
    """Velocity and acceleration a time t after `tau`; of one order to rounding also where they
    vanish at `tau`, and t is short."""
    if len(drive) != 0:
        return velocity_acceleration(drive, tau + t)
    sine = math.sin(tau)
    cosine = math.cos(tau)
    sine_t = math.sin(t)
    cosine_t = math.cos(t)
    return cosine * cosine_t - sine * sine_t, -(sine * cosine_t + cosine * sine_t)


@inline
def most_velocity(drive: Any) -> float:
    """Bound of ``|f'|``."""
    return 1.0 if len(drive) == 0 else drive.most1


@inline
def most_acceleration(drive: Any) -> float:
    """Bound of ``|f''|``."""
    return 1.0 if len(drive) == 0 else drive.most2


@inline
def most_jerk(drive: Any) -> float:
    """Bound of ``|f'''|``."""
    return 1.0 if len(drive) == 0 else drive.most3


@inline
def most_modulation(drive: Any, beta: float) -> float:
    """Bound of ``|f'' + beta f'|``."""
    return math.sqrt(1.0 + beta**2) if len(drive) == 0 else drive.most2 + beta * drive.most1


@inline
def most_modulation_rate(drive: Any, beta: float) -> float:
    """Bound of ``|f''' + beta f''|``."""
    return math.sqrt(1.0 + beta**2) if len(drive) == 0 else drive.most3 + beta * drive.most2


@lean
def t_minus_sine(t: float, sine: float) -> float:
    """``t - sin t`` for a given ``sine = sin t``; by its series where the difference would
    cancel."""
    z = t * t
    if z > 1.0:
        return t - sine
    total = 1.0
    for k in (16.0, 14.0, 12.0, 10.0, 8.0, 6.0, 4.0):
        total = 1.0 - z / (k * (k + 1.0)) * total
    return z * t / 6.0 * total


@inline
def excite(drive: Any, beta: float, p: Damped, tau: float, t: float) -> tuple[float, float]:
    """What the drive adds to a wheel in a flight from `tau` on: ``f(tau + t) - f - e f'``,
    ``f'(tau + t) - d f'``.

    e and d are the phi-functions of `beta`, in `p`.  Terms vanish with t as the sums do.
    """
    if len(drive) == 0:
        sine = math.sin(tau)
        cosine = math.cos(tau)
        sh = math.sin(0.5 * t)
        ch = math.cos(0.5 * t)
        # 1 - cos t, sin t
        versine = 2.0 * sh * sh
        sine_t = 2.0 * sh * ch
        # sin(tau + t) - sin tau - cos tau e1, with sin t - e1 = beta g1 - (t - sin t)
        ahead = beta * p.g - t_minus_sine(t, sine_t) if t < 1.0 else sine_t - p.e
        return (
            cosine * ahead - sine * versine,
            cosine * (beta * p.e - versine) - sine * sine_t,
        )
    moved = 0.0
    gained = 0.0
    unit = sine_cosine(tau)
    at = (0.0, 1.0)
    half_unit = sine_cosine(0.5 * t)
    half = (0.0, 1.0)
    for i in range(drive.order.size):
        j = drive.order[i]
        at = _turn(drive, i, tau, unit, at)
        half = _turn(drive, i, 0.5 * t, half_unit, half)
        sine = drive.odd[i] * at[0] + drive.even[i] * at[1]
        cosine = drive.odd[i] * at[1] - drive.even[i] * at[0]
        versine = 2.0 * half[0] * half[0]
        sine_t = 2.0 * half[0] * half[1]
        ahead = j * beta * p.g - t_minus_sine(j * t, sine_t) if j * t < 1.0 else sine_t - j * p.e
        moved += cosine * ahead - sine * versine
        gained += j * (cosine * (beta * p.e - versine) - sine * sine_t)
    return moved, gained


def mean_square(drive: Any, beta: float) -> float:
    """The mean of ``(f'' + beta f')^2`` over a period."""
    if not drive:
        return 0.5 * (1.0 + beta**2)
    size = (drive.odd**2 + drive.even**2) * drive.order**2 * (drive.order**2 + beta**2)
    return 0.5 * float(size.sum())


def driver_motion(drive: Any, tau: float) -> float:
    """``f``."""
    if not drive:
        return math.sin(tau)
    pairs = zip(drive.order.tolist(), drive.odd.tolist(), drive.even.tolist(), strict=True)
    return float(sum(odd * math.sin(j * tau) + even * math.cos(j * tau) for j, odd, even in pairs))
