"""Exact free flight (Eq. 3), its Jacobian, its drift, and the noise that drives it (Eqs. 5, 8).

A wheel's speed ``u_i = R_i phi_i' / (nu_1 omega)`` obeys ``u_i' = -beta_i u_i - gamma_i``
independently of the others.  It deviates by ``v_i = kappa_i alpha f' - u_i`` from its motion
without play, f the driver's motion, ``sin tau`` or a sum of orders (`rattle.scene.drive`).  The
rate of a gap is ``y_i = v_i`` at the driver and ``y_i = k_i v_p - v_i`` where the parent p is a
wheel.  Increments over a flight are summed from terms that vanish with the flight time, so the
relative accuracy is the same for flight times of 1e-12 and of 1e6.  A spring holds a wheel at the
driver that drives no other, so that its displacement is its own.
"""

import math
from typing import Any

import numpy as np

from rattle.scene.compiled import inline, internal, jit, little_code, not_inlined, splice
from rattle.scene.damping import Damped, damped, pair
from rattle.scene.drive import (
    PERIOD,
    acceleration,
    excite,
    highest_order,
    jerk,
    motion_after,
    sine_cosine,
    velocity,
    velocity_acceleration,
    whole_periods,
)
from rattle.scene.elementary import gauss_legendre
from rattle.scene.linear_algebra import add, add_outer, congruence
from rattle.scene.spring import sprung
from rattle.scene.types import Constants, Floats

# Gauss-Legendre on [0, 1]: 16 nodes are exact to rounding on panels of at most PANEL time units.
_nodes, _weights = gauss_legendre(16)
NODES = 0.5 * (_nodes + 1.0)
WEIGHTS = 0.5 * _weights
PANEL = 2.0
COMMON = -1  # source of the noise that is common to all wheels
# distance from resonance below which the swing of a wheel on a spring is not taken as settled
RESONANCE = 1e-2


@inline
def put_speeds(c: Constants, driver: float, s: Floats, u: Floats) -> None:
    """Write the speeds of the wheels at their own meshes, at a speed of the driver.

    Shapes: `s` (2 wheels,); `u` (wheels,).
    """
    for i in range(u.size):
        wheel = c.wheels[i]
        if wheel.parent < 0:
            u[i] = wheel.turn * driver - wheel.sign * s[2 * i + 1]
        else:
            u[i] = wheel.ratio * u[wheel.parent] + s[2 * i + 1]


@jit
def wheel_speeds(c: Constants, tau: float, s: Floats) -> Floats:
    """Speeds ``u_i`` of the wheels at their own meshes.

    Shapes: `s` (2 wheels,); result (wheels,).
    """
    u = np.empty(c.wheels.size)
    put_speeds(c, c.alpha * velocity(c.drive, tau), s, u)
    return u


@internal
def deviations(c: Constants) -> Floats:
    """The matrix V of ``v = V y``: the wheels' deviations from the rates of the gaps, and their
    positions from the displacements.

    Shapes: result (wheels, wheels).
    """
    v = np.zeros((c.wheels.size, c.wheels.size))
    for i, wheel in enumerate(c.wheels):
        v[i, i] = wheel.sign
        if wheel.parent >= 0:
            for j in range(i):
                v[i, j] = wheel.ratio * v[wheel.parent, j]
    return v


@internal
def respond(c: Constants, i: int, t: float) -> Damped:
    """The response of a wheel's own motion over a time: with a spring, if one holds it."""
    wheel = c.wheels[i]
    if wheel.stiffness == 0.0:
        return damped(wheel.beta, t)
    return sprung(wheel.beta, wheel.stiffness, t)


@internal
def fastest_rate(c: Constants) -> float:
    """A bound of the rates at which wheels relax or swing."""
    fastest = 0.0
    for wheel in c.wheels:
        fastest = max(fastest, wheel.fastest)
    return fastest


@internal
def _swing(drive: Any, beta: float, stiffness: float, tau: float) -> tuple[float, float, float]:
    """Displacement and rate of a wheel that a spring holds, where it has swung with the drive for
    ever, and how far the drive is from resonance: the least of ``|stiffness - j^2 + i beta j|``."""
    orders = 1 if len(drive) == 0 else drive.order.size
    x = y = 0.0
    apart = math.inf
    for i in range(orders):
        j = odd = 1.0
        even = 0.0
        if len(drive) != 0:
            j = drive.order[i]
            odd = drive.odd[i]
            even = drive.even[i]
        sine, cosine = sine_cosine(j * tau)
        # of f'' + beta f', in units of its sine and cosine
        by_sine = -j * (j * odd + beta * even)
        by_cosine = j * (beta * odd - j * even)
        off = stiffness - j * j
        lag = beta * j
        square = off * off + lag * lag
        if square == 0.0:
            return 0.0, 0.0, 0.0
        of_sine = (off * by_sine + lag * by_cosine) / square
        of_cosine = (off * by_cosine - lag * by_sine) / square
        x += of_sine * sine + of_cosine * cosine
        y += j * (of_sine * cosine - of_cosine * sine)
        apart = min(apart, math.sqrt(square))
    return x, y, apart


@internal
def _excite_sprung(
    drive: Any, beta: float, stiffness: float, tau: float, t: float
) -> tuple[float, float]:
    """What the drive adds to displacement and rate of a wheel that a spring holds, in a flight from
    `tau` on.

    Over a longer time the swing at its end less what is left of that at its start.  Over a short
    one, and near resonance, these would cancel: by Gauss-Legendre quadrature on panels, each
    carried through the next.
    """
    not_inlined()
    fastest = beta + math.sqrt(stiffness) + highest_order(drive)
    panels = max(1, math.ceil(abs(t) * fastest / PANEL))
    if panels > 1:
        x, y, apart = _swing(drive, beta, stiffness, tau)
        if apart > RESONANCE:
            x_end, y_end, _ = _swing(drive, beta, stiffness, tau + t)
            p = sprung(beta, stiffness, t)
            moved = x_end - (x + (y * p.e - stiffness * x * p.g))
            gained = y_end - (y * p.d - stiffness * x * p.e)
            return moved, gained
    h = t / panels
    over = sprung(beta, stiffness, h)
    moved = gained = 0.0
    for k in range(panels):
        pull = -stiffness * moved
        moved += pull * over.g + gained * over.e
        gained = pull * over.e + gained * over.d
        for n in range(NODES.size):
            p = sprung(beta, stiffness, h * NODES[n])
            first, second = velocity_acceleration(drive, tau + (k + 1.0 - NODES[n]) * h)
            m = h * WEIGHTS[n] * (second + beta * first)
            moved += p.e * m
            gained += p.d * m
    return moved, gained


@internal
def displace(c: Constants, tau: float, u: Floats, s: Floats, t: float, out: Floats) -> None:
    """Increments of the displacements over a flight of time `t` from `tau`, and the rates at its
    end (Eq. 3).

    Shapes: `u` (wheels,), the wheels' speeds at the start; `s`, `out` (2 wheels,).
    """
    for i, wheel in enumerate(c.wheels):
        y = s[2 * i + 1]
        if wheel.parent < 0:
            p = respond(c, i, t)
            moved = gained = 0.0
            if wheel.stiffness == 0.0:
                moved, gained = excite(c.drive, wheel.beta, p, tau, t)
            elif c.alpha > 0.0:
                moved, gained = _excite_sprung(c.drive, wheel.beta, wheel.stiffness, tau, t)
            pushed = wheel.sign * wheel.turn * c.alpha
            force = wheel.drag - wheel.stiffness * s[2 * i]
            out[2 * i] = y * p.e + force * p.g + pushed * moved
            out[2 * i + 1] = y * p.d + force * p.e + pushed * gained
        else:
            parent = c.wheels[wheel.parent]
            q = pair(parent.beta, wheel.beta, t)
            speed = wheel.ratio * u[wheel.parent]
            drag = wheel.ratio * parent.gamma
            out[2 * i] = y * q.e2 - speed * q.e12 + (drag * q.g1 - wheel.gamma * q.g2)
            out[2 * i + 1] = y * q.d2 - speed * q.d12 + (drag * q.e1 - wheel.gamma * q.e2)


@jit
def flow(c: Constants, tau: float, s: Floats, t: float) -> Floats:
    """State after a flight of time `t` from `tau` (Eq. 3; Eq. 10 is this map after a mesh-1
    impact).

    Shapes: `s`, result (2 wheels,).
    """
    out = np.empty(s.size)
    displace(c, tau, wheel_speeds(c, tau, s), s, t, out)
    for i in range(c.wheels.size):
        out[2 * i] += s[2 * i]
    return out


@internal
def field(c: Constants, tau: float, s: Floats) -> Floats:
    """The drift, ``d(x1, y1, ...) / d tau`` in flight without noise (Eq. 3).

    Shapes: `s`, result (2 wheels,).
    """
    u = wheel_speeds(c, tau, s)
    f = np.empty(s.size)
    for i, wheel in enumerate(c.wheels):
        x = 2 * i
        y = x + 1
        f[x] = s[y]
        if wheel.parent < 0:
            pull = wheel.beta * u[i] + wheel.gamma
            driver = wheel.turn * c.alpha * acceleration(c.drive, tau)
            f[y] = wheel.sign * (driver + pull) - wheel.stiffness * s[x]
        else:
            relative = -wheel.coupling * u[wheel.parent] - wheel.beta * s[y]
            f[y] = relative + wheel.drag
    return f


@internal
def field_rate(c: Constants, tau: float) -> Floats:
    """Partial derivative of the drift `field` with respect to time.

    Shapes: result (2 wheels,).
    """
    f = np.zeros(2 * c.wheels.size)
    second = acceleration(c.drive, tau)
    third = jerk(c.drive, tau)
    for i, wheel in enumerate(c.wheels):
        f[2 * i + 1] = c.alpha * (wheel.second * third + wheel.first * second)
    return f


@internal
def system_matrix(c: Constants) -> Floats:
    """``A`` of the linear flight ``s' = A s + ...`` (Eq. 8).

    Shapes: result (2 wheels, 2 wheels).
    """
    size = 2 * c.wheels.size
    a = np.zeros((size, size))
    v = deviations(c)
    for i, wheel in enumerate(c.wheels):
        x = 2 * i
        y = x + 1
        a[x, y] = 1.0
        a[y, x] = -wheel.stiffness
        a[y, y] = -wheel.beta
        if wheel.parent >= 0:
            for j in range(i):
                a[y, 2 * j + 1] = wheel.coupling * v[wheel.parent, j]
    return a


@internal
def _propagate(c: Constants, v: Floats, t: float) -> Floats:
    """``exp(A t)`` in coordinates in which the wheels' deviations are ``v = V y``; a wheel in whose
    deviation that of its parent has no part is its own coordinate, and flies by itself.

    Shapes: `v` (wheels, wheels); result (2 wheels, 2 wheels).
    """
    size = 2 * c.wheels.size
    j = np.zeros((size, size))
    for i, wheel in enumerate(c.wheels):
        p = respond(c, i, t)
        x = 2 * i
        y = x + 1
        j[x, x] = 1.0 - wheel.stiffness * p.g
        j[x, y] = p.e
        j[y, x] = -wheel.stiffness * p.e
        j[y, y] = p.d
        if wheel.parent >= 0 and v[i, wheel.parent] != 0.0:
            q = pair(c.wheels[wheel.parent].beta, wheel.beta, t)
            for k in range(i):
                speed = wheel.ratio * v[wheel.parent, k]
                j[x, 2 * k + 1] = speed * q.e12
                j[y, 2 * k + 1] = speed * q.d12
    return j


@internal
def jacobian(c: Constants, t: float) -> Floats:
    """``exp(A t)``, the derivative of `flow` with respect to the state.

    Shapes: result (2 wheels, 2 wheels).
    """
    return _propagate(c, deviations(c), t)


@internal
def noise_rate(c: Constants, tau: float, i: int) -> float:
    """Noise coefficient of ``y_i`` for the one white noise ``sigma eta`` (Eq. 5), for ``sigma =
    1``."""
    first, second = velocity_acceleration(c.drive, tau)
    wheel = c.wheels[i]
    modulation = wheel.second * second + wheel.first * first
    rate: float = c.modulates * modulation + wheel.force
    return rate


@internal
def _intensity(c: Constants, source: int, i: int) -> float:
    """Intensity on a wheel of a noise: of the common one, or of the one that acts on the wheel
    `source` alone."""
    if source == COMMON:
        return float(c.wheels[i].own)
    return float(c.wheels[i].alone) if i == source else 0.0


@splice
def _respond_own(c: Constants, source: int, v: Floats, lag: float, g: Floats) -> None:
    """Response of the coordinates to unit noise that acts on wheels themselves, a lag earlier.

    Shapes: `g` (2 wheels,).
    """
    for i, wheel in enumerate(c.wheels):
        p = respond(c, i, lag)
        pushed = wheel.sign * _intensity(c, source, i)
        g[2 * i] = pushed * p.e
        g[2 * i + 1] = pushed * p.d
        if wheel.parent >= 0 and v[i, wheel.parent] != 0.0:
            parent = c.wheels[wheel.parent]
            others = damped(parent.beta, lag)
            carried = wheel.ratio * _intensity(c, source, wheel.parent)
            g[2 * i] += carried * others.e
            g[2 * i + 1] += carried * others.d


@internal
def _respond(
    c: Constants, source: int, v: Floats, lag: float, sine: float, cosine: float, g: Floats
) -> None:
    """Response of the coordinates to unit noise a lag earlier (see `noise_covariance`).

    `sine` and `cosine` are of the phase at which the noise acts, or ``-f''`` and ``f'`` of several
    orders there. Shapes: `g` (2 wheels,).
    """
    if c.modulates == 0.0 or source != COMMON:
        _respond_own(c, source, v, lag, g)
        return
    for i, wheel in enumerate(c.wheels):
        if wheel.parent < 0 or v[i, wheel.parent] == 0.0:
            p = respond(c, i, lag)
            m = wheel.sign * wheel.turn * (wheel.beta * cosine - sine)
            g[2 * i] = p.e * m
            g[2 * i + 1] = p.d * m
            continue
        beta = c.wheels[wheel.parent].beta
        q = pair(beta, wheel.beta, lag)
        d = beta - wheel.beta
        # beta_1 d1 - beta_2 d2
        faster = d * q.d1 + wheel.beta * q.d12 if d > 0.0 else d * q.d2 + beta * q.d12
        g[2 * i] = wheel.turn * (-cosine * q.d12 - sine * q.e12)
        g[2 * i + 1] = wheel.turn * (cosine * faster - sine * q.d12)


@internal
def _over_panels(c: Constants, source: int, v: Floats, tau: float, t: float) -> Floats:
    """Covariance of unit noise by Gauss-Legendre quadrature on panels of the lag before the end.

    Panels grow with the lag, for what is damped fast is over by then; a spring swings on.
    """
    size = 2 * c.wheels.size
    swing = 0.0
    for i in range(c.wheels.size):
        swing = max(swing, c.wheels[i].stiffness)
    swing = math.sqrt(swing)
    longest = PANEL / max(highest_order(c.drive), swing)
    panel = PANEL / max(fastest_rate(c), highest_order(c.drive))
    q = np.zeros((size, size))
    g = np.zeros(size)
    past = 0.0
    while past < t:
        h = min(panel, t - past)
        for n in range(NODES.size):
            lag = past + h * NODES[n]
            first, second = motion_after(c.drive, tau, t - lag)
            _respond(c, source, v, lag, -second, first, g)
            add_outer(q, h * WEIGHTS[n], g, g)
        past += h
        panel = min(2.0 * panel, longest)
    return q


@splice
def _over_periods(c: Constants, source: int, v: Floats, tau: float, t: float) -> Floats:
    """Covariance of the coordinates of `noise_covariance` by unit noise: whole periods by doubling,
    then the rest of the time."""
    periods, rest = whole_periods(t)
    out = _over_panels(c, source, v, tau, rest)
    if periods > 0:
        whole = np.zeros(out.shape)
        q = _over_panels(c, source, v, tau, PERIOD)
        h = PERIOD
        while periods > 0:
            carry = _propagate(c, v, h)
            if periods & 1:
                whole = congruence(carry, whole)
                add(whole, q)
            later = congruence(carry, q)
            add(q, later)
            periods >>= 1
            h *= 2.0
        add(out, congruence(_propagate(c, v, rest), whole))
    return out


@splice
def _stand_apart(c: Constants, t: float) -> Floats:
    """1 for each wheel whose noise is integrated apart from that of its parent, else 0: their
    dampings differ much over the time for which speeds last."""
    apart = np.zeros(c.wheels.size)
    for i, wheel in enumerate(c.wheels):
        if wheel.parent >= 0:
            beta = c.wheels[wheel.parent].beta
            most = max(beta, wheel.beta)
            lasting = min(t, 1.0 / most) if most > 0.0 else t
            apart[i] = 1.0 if abs(beta - wheel.beta) * lasting > 0.5 else 0.0
    return apart


@jit
def noise_covariance(c: Constants, tau: float, t: float) -> Floats:
    """Covariance of the state that the noise adds in a flight of time `t` from `tau`.

    ``sigma^2 int exp(A r) m m' exp(A' r) dr`` over the lag r before the end of the flight, ``m``
    the modulation of Eq. 5.  A period is summed on panels on which Gauss-Legendre quadrature is
    exact to rounding, and then doubled: a flight of time 1e6 takes eighteen doublings.  Independent
    noises of single wheels add covariances of their own.

    A wheel whose damping differs much from its parent's is integrated by its own deviation, which
    decouples the two.  Elsewhere the gap itself is integrated: its small variance would be lost as
    a difference.

    Shapes: result (2 wheels, 2 wheels).
    """
    little_code()
    size = 2 * c.wheels.size
    apart = _stand_apart(c, t)
    # deviations v and gaps y of the coordinates: a wheel apart is the coordinate sign v itself
    v = deviations(c)
    gaps = np.eye(c.wheels.size)
    for i, wheel in enumerate(c.wheels):
        for j in range(i):
            carried = wheel.ratio * v[wheel.parent, j] if wheel.parent >= 0 else 0.0
            v[i, j] = 0.0 if apart[i] != 0.0 else carried
            gaps[i, j] = carried if apart[i] != 0.0 else 0.0
    out = np.zeros((size, size))
    for source in range(COMMON, c.wheels.size):
        if source == COMMON or c.wheels[source].alone > 0.0:
            add(out, _over_periods(c, source, v, tau, t))
    to_gaps = np.zeros((size, size))
    square = c.sigma * c.sigma
    for i in range(c.wheels.size):
        for j in range(i + 1):
            to_gaps[2 * i, 2 * j] = to_gaps[2 * i + 1, 2 * j + 1] = gaps[i, j]
    out = congruence(to_gaps, out)
    for i in range(size):
        for j in range(size):
            out[i, j] *= square
    return out
