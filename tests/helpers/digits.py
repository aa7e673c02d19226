"""The formulas of docs/model.md sections 2, 3 and 6 in 400 digits, as they stand there.

Written wheel by wheel, with divisions by beta: with so many digits cancellation does not matter,
and beta = 0 can be replaced by 1e-30.  No function of `rattle` is used.
"""

import mpmath as mp

DIGITS = 400
NIL = "1e-30"

in_digits = mp.workdps(DIGITS)
"""Decorator of a function that computes with so many decimal digits."""


def _betas(c):
    return mp.mpf(c.beta1 or NIL), mp.mpf(c.beta2 or NIL)


def _phi(beta, t):
    """Decay, phi1 and phi2 of damping."""
    e = -mp.expm1(-beta * t) / beta
    return mp.exp(-beta * t), e, (t - e) / beta


@in_digits
def phi_functions(beta, t):
    """phi1 and phi2 of damping as doubles."""
    _, e, g = _phi(mp.mpf(beta or NIL), mp.mpf(t))
    return float(e), float(g)


@in_digits
def flight(c, tau, y1, y2, t):
    """Changes of x1 and x2 and new y1 and y2 after a flight, in the order of the state; and the sum
    of the absolute values of their terms."""
    b1, b2 = _betas(c)
    a, g1, g2, tau, t = (mp.mpf(v) for v in (c.alpha, c.gamma1, c.gamma2, tau, t))
    sine = mp.sin(tau)
    cosine = mp.cos(tau)
    d1, e1, drag1 = _phi(b1, t)
    d2, e2, drag2 = _phi(b2, t)
    u1 = a * cosine - y1
    u2 = u1 + y2
    s1 = u1 * e1 - g1 * drag1
    s2 = u2 * e2 - g2 * drag2
    v1 = u1 * d1 - g1 * e1
    v2 = u2 * d2 - g2 * e2
    values = a * (mp.sin(tau + t) - sine) - s1, a * mp.cos(tau + t) - v1, s2 - s1, v2 - v1
    versine = 1 - mp.cos(t)
    speed = abs(a * cosine) + abs(y1)
    driven_x = abs(cosine * (mp.sin(t) - e1)) + abs(sine) * versine
    driven_y = abs(cosine) * (b1 * e1 + versine) + abs(sine * mp.sin(t))
    sizes = (
        abs(y1) * e1 + g1 * drag1 + a * driven_x,
        abs(y1) * d1 + g1 * e1 + a * driven_y,
        abs(y2) * e2 + speed * abs(e1 - e2) + g1 * drag1 + g2 * drag2,
        abs(y2) * d2 + speed * abs(d1 - d2) + g1 * e1 + g2 * e2,
    )
    return [float(v) for v in values], [float(v) for v in sizes]


@in_digits
def jacobian(c, t):
    """The Jacobian of a flight, ``exp(A t)``."""
    d1, e1, _ = _phi(_betas(c)[0], mp.mpf(t))
    d2, e2, _ = _phi(_betas(c)[1], mp.mpf(t))
    rows = [1, e1, 0, 0], [0, d1, 0, 0], [0, e1 - e2, 1, e2], [0, d1 - d2, 0, d2]
    return [[float(v) for v in row] for row in rows]


def _responses(c, end):
    """Responses ``Re sum_k C[i, k] exp(rate_k lag)`` of the state at the phase `end` to a unit
    impulse of noise a lag earlier: C and the rates."""
    b1, b2 = _betas(c)
    # the modulation of wheel j is -sin + beta_j cos = Re (beta_j + i) exp(i (end - lag))
    z1 = (b1 + 1j) * mp.expj(end)
    z2 = (b2 + 1j) * mp.expj(end)
    amplitudes = mp.matrix(
        [
            [z1 / b1, -z1 / b1, 0],
            [0, z1, 0],
            [z1 / b1 - z2 / b2, -z1 / b1, z2 / b2],
            [0, z1, -z2],
        ]
    )
    return amplitudes, (mp.mpc(0, -1), -b1 - 1j, -b2 - 1j)


@in_digits
def noise(c, tau, t):
    """The covariance that the noise adds in a flight."""
    time = mp.mpf(t)
    amplitudes, rates = _responses(c, mp.mpf(tau) + time)

    def integral(rate):
        return mp.expm1(rate * time) / rate if rate else time

    # Re f Re g = Re (f g + f g*) / 2
    total = mp.zeros(4)
    for other, turned in (
        (amplitudes.T, rates),
        (amplitudes.H, [mp.conj(rate) for rate in rates]),
    ):
        integrals = mp.matrix([[integral(r + s) for s in turned] for r in rates])
        total += amplitudes * integrals * other
    scale = mp.mpf(c.sigma) ** 2 / 2
    return [[float(mp.re(scale * total[i, j])) for j in range(4)] for i in range(4)]


@in_digits
def step_noise(c, tau, h, increment, slope):
    """What the noise ``(increment + slope (s / h - 1/2)) / h`` at a time s of a step of length h
    adds to the state."""
    amplitudes, rates = _responses(c, mp.mpf(tau) + mp.mpf(h))
    integrals = []
    for rate in rates:
        plain = mp.expm1(rate * h) / rate
        first = (h * mp.exp(rate * h) - plain) / rate  # of the lag
        integrals.append((increment + slope / 2) * plain - slope / h * first)
    return [float(mp.re(v)) * c.sigma / h for v in amplitudes * mp.matrix(integrals)]


@in_digits
def saltation(c, mesh, tau, y1, y2):
    """The saltation matrix ``R + (F+ - R F-) g' / (g' F-)``, and for each entry the sum of the
    absolute values of its terms."""
    eps = mp.mpf(c.epsilon)
    restitution = mp.eye(4)
    j = 2 * (mesh - 1)
    restitution[j + 1, j + 1] = -eps
    restitution[3 - j, j + 1] = -(1 + eps) * (1 if mesh == 1 else mp.mpf(c.mu))
    driver = mp.mpf(c.alpha) * mp.cos(tau), -mp.mpf(c.alpha) * mp.sin(tau)

    def rate(driver, minus, s):
        """The drift; of absolute values, with ``minus = 1``, the sum of those of its terms."""
        u1 = driver[0] + minus * s[1]
        pull1 = c.beta1 * u1 + mp.mpf(c.gamma1)
        pull2 = c.beta2 * (u1 + s[3]) + mp.mpf(c.gamma2)
        return mp.matrix([s[1], driver[1] + pull1, s[3], pull1 + minus * pull2])

    before = mp.matrix([0, y1, 0, y2])
    after = restitution * before
    driver_size = [abs(v) for v in driver]
    f = rate(driver, -1, before)
    jump = rate(driver, -1, after) - restitution * f
    size = restitution.apply(abs)
    jump_size = rate(driver_size, 1, after.apply(abs))
    jump_size += size * rate(driver_size, 1, before.apply(abs))
    for i in range(4):
        restitution[i, j] += jump[i] / f[j]
        size[i, j] += jump_size[i] / abs(f[j])
    return tuple([[float(v) for v in row] for row in m.tolist()] for m in (restitution, size))


@in_digits
def window_integrals(low, high, order):
    """``int z^n phi(z) dz`` and ``int |z|^n phi(z) dz`` over a window, for every n up to an
    order."""

    def by_parts(a, b):
        """Over ``a <= z <= b``, from the error function upwards."""
        edges = [mp.npdf(a), mp.npdf(b)]
        out = [mp.ncdf(b) - mp.ncdf(a), edges[0] - edges[1]]
        for n in range(2, order + 1):
            ends = a ** (n - 1) * edges[0] - b ** (n - 1) * edges[1]
            out.append(ends + (n - 1) * out[n - 2])
        return out

    low = mp.mpf(low)
    high = mp.mpf(high)
    middle = min(max(low, mp.mpf(0)), high)  # z has one sign on either side of it
    parts = list(zip(by_parts(low, middle), by_parts(middle, high), strict=True))
    return [a + b for a, b in parts], [abs(a) + abs(b) for a, b in parts]
