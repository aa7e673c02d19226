"""The formulas of docs/model.md sections 2 and 6 in 400 digits, as they stand there.

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


def _flown(c, tau, s, t):
    """Changes of the displacements and new rates after a flight, in the order of the state."""
    moved = []
    gained = []
    for wheel, turn, beta, vi in zip(
        c.wheels, _turns(c), _betas(c), _deviations(c, s), strict=True
    ):
        d, e, drag = _phi(beta, t)
        driver = turn * mp.mpf(c.alpha)
        speed = driver * mp.cos(tau) - vi
        gamma = mp.mpf(wheel.gamma)
        moved.append(driver * (mp.sin(tau + t) - mp.sin(tau)) - (speed * e - gamma * drag))
        gained.append(driver * mp.cos(tau + t) - (speed * d - gamma * e))
    return [_gap(wheel, i, of) for i, wheel in enumerate(c.wheels) for of in (moved, gained)]


@in_digits
def flight(c, tau, s, t):
    """The end of a flight, as `_flown`, and the sum of the absolute values of its terms."""
    tau, t = (mp.mpf(v) for v in (tau, t))
    sine = abs(mp.sin(tau))
    cosine = abs(mp.cos(tau))
    versine = 1 - mp.cos(t)
    parts = [_phi(beta, t) for beta in _betas(c)]
    drivers = [turn * mp.mpf(c.alpha) for turn in _turns(c)]
    speeds = [
        driver * cosine + abs(vi) for driver, vi in zip(drivers, _deviations(c, s), strict=True)
    ]
    sizes = []
    for i, (wheel, (d, e, drag)) in enumerate(zip(c.wheels, parts, strict=True)):
        y = abs(mp.mpf(s[2 * i + 1]))
        size = [y * e + wheel.gamma * drag, y * d + wheel.gamma * e]
        if wheel.parent < 0:
            size[0] += drivers[i] * (cosine * abs(mp.sin(t) - e) + sine * versine)
            size[1] += drivers[i] * (cosine * (wheel.beta * e + versine) + sine * abs(mp.sin(t)))
        else:
            parent = c.wheels[wheel.parent]
            other_d, other_e, other_drag = parts[wheel.parent]
            speed = speeds[wheel.parent]
            size[0] += wheel.ratio * (speed * abs(other_e - e) + parent.gamma * other_drag)
            size[1] += wheel.ratio * (speed * abs(other_d - d) + parent.gamma * other_e)
        sizes += size
    return [float(v) for v in _flown(c, tau, s, t)], [float(v) for v in sizes]


@in_digits
def jacobian(c, t):
    """The Jacobian of a flight, ``exp(A t)``: what a unit of each rate adds."""
    size = 2 * len(c.wheels)
    time = mp.mpf(t)
    rest = _flown(c, 0, [0] * size, time)
    columns = mp.eye(size).tolist()
    for j in range(1, size, 2):
        flown = _flown(c, 0, columns[j], time)
        columns[j] = [a - b for a, b in zip(flown, rest, strict=True)]
    return [[float(column[i]) for column in columns] for i in range(size)]


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
