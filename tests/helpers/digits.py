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
    return [mp.mpf(wheel.beta or NIL) for wheel in c.wheels]


def _turns(c):
    """Products of the ratios from the driver on, unrounded: between two wheels the driver's push
    cancels."""
    turns = []
    for wheel in c.wheels:
        turns.append(mp.mpf(wheel.ratio) * (turns[wheel.parent] if wheel.parent >= 0 else 1))
    return turns


def _phi(beta, t):
    """Decay, phi1 and phi2 of damping."""
    e = -mp.expm1(-beta * t) / beta
    return mp.exp(-beta * t), e, (t - e) / beta


@in_digits
def phi_functions(beta, t):
    """phi1 and phi2 of damping as doubles."""
    _, e, g = _phi(mp.mpf(beta or NIL), mp.mpf(t))
    return float(e), float(g)


def _gap(wheel, i, of):
    """``sign (of_i - k of_parent)`` of a wheel; `of` by wheel."""
    carried = mp.mpf(wheel.ratio) * of[wheel.parent] if wheel.parent >= 0 else 0
    return mp.mpf(wheel.sign) * (of[i] - carried)


def _deviations(c, s):
    """Deviations v of the wheels' speeds from the rates of a state."""
    v = []
    for i, wheel in enumerate(c.wheels):
        carried = mp.mpf(wheel.ratio) * v[wheel.parent] if wheel.parent >= 0 else 0
        v.append(mp.mpf(wheel.sign) * mp.mpf(s[2 * i + 1]) + carried)
    return v


@in_digits
def flight(c, tau, s, t):
    """Changes of the displacements and new rates after a flight, in the order of the state; and the
    sum of the absolute values of their terms."""
    a, tau, t = (mp.mpf(v) for v in (c.alpha, tau, t))
    sine = mp.sin(tau)
    cosine = mp.cos(tau)
    versine = 1 - mp.cos(t)
    moved = []
    gained = []
    parts = [_phi(beta, t) for beta in _betas(c)]
    v = _deviations(c, s)
    speeds = []
    turns = _turns(c)
    for wheel, turn, (d, e, drag), vi in zip(c.wheels, turns, parts, v, strict=True):
        driver = turn * a
        speed = driver * cosine - vi
        speeds.append(abs(driver * cosine) + abs(vi))
        gamma = mp.mpf(wheel.gamma)
        moved.append(driver * (mp.sin(tau + t) - sine) - (speed * e - gamma * drag))
        gained.append(driver * mp.cos(tau + t) - (speed * d - gamma * e))
    values = []
    sizes = []
    for i, (wheel, (d, e, drag)) in enumerate(zip(c.wheels, parts, strict=True)):
        values += [_gap(wheel, i, moved), _gap(wheel, i, gained)]
        y = abs(mp.mpf(s[2 * i + 1]))
        size = [y * e + wheel.gamma * drag, y * d + wheel.gamma * e]
        if wheel.parent < 0:
            driver = turns[i] * a
            size[0] += driver * (abs(cosine * (mp.sin(t) - e)) + abs(sine) * versine)
            size[1] += driver * (
                abs(cosine) * (mp.mpf(wheel.beta) * e + versine) + abs(sine * mp.sin(t))
            )
        else:
            parent = c.wheels[wheel.parent]
            other_d, other_e, other_drag = parts[wheel.parent]
            k = mp.mpf(wheel.ratio)
            speed = k * speeds[wheel.parent]
            size[0] += speed * abs(other_e - e) + k * parent.gamma * other_drag
            size[1] += speed * abs(other_d - d) + k * parent.gamma * other_e
        sizes += size
    return [float(v) for v in values], [float(v) for v in sizes]


@in_digits
def jacobian(c, t):
    """The Jacobian of a flight, ``exp(A t)``."""
    size = 2 * len(c.wheels)
    parts = [_phi(beta, mp.mpf(t)) for beta in _betas(c)]
    rows = mp.eye(size)
    for j in range(len(c.wheels)):
        unit = [0] * size
        unit[2 * j + 1] = 1
        v = _deviations(c, unit)
        for i, wheel in enumerate(c.wheels):
            for at, place in ((2 * i, 1), (2 * i + 1, 0)):
                moved = [vi * part[place] for vi, part in zip(v, parts, strict=True)]
                rows[at, 2 * j + 1] = _gap(wheel, i, moved)
    return [[float(rows[i, j]) for j in range(size)] for i in range(size)]


def _responses(c, end):
    """Responses ``Re sum_k C[i, k] exp(rate_k lag)`` of the state at the phase `end` to a unit
    impulse of noise a lag earlier: C and the rates."""
    wheels = len(c.wheels)
    betas = _betas(c)
    # modulation of wheel j: kappa (beta_j cos - sin) = Re kappa (beta_j + i) exp(i (end - lag))
    z = [turn * (beta + 1j) * mp.expj(end) for turn, beta in zip(_turns(c), betas, strict=True)]
    at_rest = [value / beta for value, beta in zip(z, betas, strict=True)]
    amplitudes = mp.zeros(2 * wheels, 1 + wheels)
    for i, wheel in enumerate(c.wheels):
        amplitudes[2 * i, 0] = _gap(wheel, i, at_rest)
        for j in range(wheels):
            alone = [0] * wheels
            alone[j] = z[j]
            amplitudes[2 * i + 1, 1 + j] = _gap(wheel, i, alone)
            alone[j] = -at_rest[j]
            amplitudes[2 * i, 1 + j] = _gap(wheel, i, alone)
    return amplitudes, (mp.mpc(0, -1), *(-beta - 1j for beta in betas))


@in_digits
def noise(c, tau, t):
    """The covariance that the noise adds in a flight."""
    time = mp.mpf(t)
    amplitudes, rates = _responses(c, mp.mpf(tau) + time)

    def integral(rate):
        return mp.expm1(rate * time) / rate if rate else time

    # Re f Re g = Re (f g + f g*) / 2
    size = 2 * len(c.wheels)
    total = mp.zeros(size)
    for other, turned in (
        (amplitudes.T, rates),
        (amplitudes.H, [mp.conj(rate) for rate in rates]),
    ):
        integrals = mp.matrix([[integral(r + s) for s in turned] for r in rates])
        total += amplitudes * integrals * other
    scale = mp.mpf(c.sigma) ** 2 / 2
    return [[float(mp.re(scale * total[i, j])) for j in range(size)] for i in range(size)]


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
def saltation(c, mesh, tau, before):
    """The saltation matrix ``R + (F+ - R F-) g' / (g' F-)``, and for each entry the sum of the
    absolute values of its terms."""
    j = 2 * (mesh - 1)
    size = len(before)
    restitution = mp.eye(size)
    struck = c.wheels[mesh - 1]
    eps = mp.mpf(struck.epsilon)
    # impulse of a unit rate, over what it changes there
    mobility = [mp.mpf(0)] * len(c.wheels)
    mobility[mesh - 1] = 1 / mp.mpf(struck.mass)
    if struck.parent >= 0:
        k = mp.mpf(struck.ratio)
        mobility[struck.parent] = -k / mp.mpf(c.wheels[struck.parent].mass)
    own = _gap(struck, mesh - 1, mobility)
    turns = _turns(c)
    for i, wheel in enumerate(c.wheels):
        restitution[2 * i + 1, j + 1] -= (1 + eps) * _gap(wheel, i, mobility) / own

    def rate(s, absolute=False):
        """The drift, or the sum of the absolute values of its terms."""
        driver = mp.mpf(c.alpha) * mp.cos(tau)
        pushed = -mp.mpf(c.alpha) * mp.sin(tau)
        v = _deviations(c, s)
        sizes = []
        forces = []
        for wheel, turn, vi in zip(c.wheels, turns, v, strict=True):
            beta = mp.mpf(wheel.beta)
            forces.append(turn * pushed + beta * (turn * driver - vi) + mp.mpf(wheel.gamma))
            sizes.append(beta * (abs(turn * driver) + abs(vi)) + mp.mpf(wheel.gamma))
        out = []
        for i, wheel in enumerate(c.wheels):
            force = _gap(wheel, i, forces)
            if absolute:
                inner = mp.mpf(wheel.ratio) * sizes[wheel.parent] if wheel.parent >= 0 else 0
                driven = abs(turns[i] * pushed) if wheel.parent < 0 else 0
                force = sizes[i] + inner + driven
            out += [abs(s[2 * i + 1]) if absolute else s[2 * i + 1], force]
        return mp.matrix(out)

    before = mp.matrix([value if i % 2 else 0 for i, value in enumerate(before)])
    after = restitution * before
    f = rate(before)
    jump = rate(after) - restitution * f
    size_of = restitution.apply(abs)
    jump_size = rate(after, absolute=True) + size_of * rate(before, absolute=True)
    for i in range(size):
        restitution[i, j] += jump[i] / f[j]
        size_of[i, j] += jump_size[i] / abs(f[j])
    return tuple([[float(v) for v in row] for row in m.tolist()] for m in (restitution, size_of))


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
