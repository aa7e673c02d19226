"""The formulas of docs/model.md sections 2, 3 and 6 in 400 digits, as they stand there.

Written for the wheels apart, with divisions by beta: with so many digits cancellation does not
matter, and beta = 0 can be replaced by 1e-30.  No function of `rattle` is used.
"""

import mpmath as mp
import numpy as np

DIGITS = 400
NIL = 1e-30

in_digits = mp.workdps(DIGITS)
"""Decorator of a function that computes with so many decimal digits."""
exact = np.frompyfunc(mp.mpf, 1, 1)
exp = np.frompyfunc(mp.exp, 1, 1)
expm1 = np.frompyfunc(mp.expm1, 1, 1)
real = np.frompyfunc(mp.re, 1, 1)


class Wheels:
    """The numbers of all wheels; `speeds` turns rates of gaps into speeds of wheels, `gaps` turns
    them back."""

    def __init__(self, c):
        wheels = c.wheels
        self.first = wheels["parent"] < 0
        self.parent = wheels["parent"]
        self.beta = exact(np.where(wheels["beta"] == 0.0, NIL, wheels["beta"]))
        self.gamma = exact(wheels["gamma"])
        self.ratio = exact(wheels["ratio"])
        # unrounded: between two wheels the driver's push cancels
        self.turn = self.ratio.copy()
        self.speeds = exact(np.diag(wheels["sign"]))
        self.gaps = self.speeds.copy()
        for i, parent in enumerate(self.parent):
            if parent >= 0:
                self.turn[i] *= self.turn[parent]
                self.speeds[i] += self.ratio[i] * self.speeds[parent]
                self.gaps[i, parent] = -self.gaps[i, i] * self.ratio[i]

    def fly(self, t):
        """Decay, phi1 and phi2 of damping."""
        e = -expm1(-self.beta * t) / self.beta
        return exp(-self.beta * t), e, (t - e) / self.beta


def _in_turn(x, y):
    """Of each gap the displacement and the rate, as doubles."""
    return np.column_stack([x, y]).ravel().astype(float)


@in_digits
def phi_functions(beta, t):
    """phi1 and phi2 of damping as doubles."""
    b = mp.mpf(beta or NIL)
    e = -mp.expm1(-b * t) / b
    return float(e), float((t - e) / b)


@in_digits
def flight(c, tau, s, t):
    """Changes of the displacements and new rates after a flight, in the order of the state; and the
    sum of the absolute values of their terms."""
    w = Wheels(c)
    tau = mp.mpf(tau)
    t = mp.mpf(t)
    sine = mp.sin(tau)
    cosine = mp.cos(tau)
    versine = 1 - mp.cos(t)
    d, e, drag = w.fly(t)
    y = exact(s[1::2])
    v = w.speeds @ y
    driver = w.turn * mp.mpf(c.alpha)
    speed = driver * cosine - v
    moved = driver * (mp.sin(tau + t) - sine) - (speed * e - w.gamma * drag)
    gained = driver * mp.cos(tau + t) - (speed * d - w.gamma * e)
    swung = abs(cosine * (mp.sin(t) - e)) + abs(sine) * versine
    turned = abs(cosine) * (w.beta * e + versine) + abs(sine * mp.sin(t))
    # of a wheel behind another, whose push by the driver cancels
    before = w.parent
    speeds = (abs(driver * cosine) + abs(v))[before]
    apart = speeds * abs(e[before] - e) + w.gamma[before] * drag[before]
    faster = speeds * abs(d[before] - d) + w.gamma[before] * e[before]
    x_size = abs(y) * e + w.gamma * drag + np.where(w.first, driver * swung, w.ratio * apart)
    y_size = abs(y) * d + w.gamma * e + np.where(w.first, driver * turned, w.ratio * faster)
    return _in_turn(w.gaps @ moved, w.gaps @ gained), _in_turn(x_size, y_size)


@in_digits
def jacobian(c, t):
    """The Jacobian of a flight, ``exp(A t)``."""
    w = Wheels(c)
    decay, e, _ = w.fly(mp.mpf(t))
    rows = np.eye(2 * w.beta.size)
    rows[::2, 1::2] = w.gaps * e @ w.speeds
    rows[1::2, 1::2] = w.gaps * decay @ w.speeds
    return rows


def _responses(c, end):
    """Responses ``Re sum_k C[i, k] exp(rate_k lag)`` of the state at the phase `end` to a unit
    impulse of noise a lag earlier: C and the rates."""
    w = Wheels(c)
    # modulation of wheel j: kappa (beta_j cos - sin) = Re kappa (beta_j + i) exp(i (end - lag))
    z = w.turn * (w.beta + 1j) * mp.expj(end)
    at_rest = z / w.beta
    amplitudes = np.zeros((2 * z.size, 1 + z.size), object)
    amplitudes[::2, 0] = w.gaps @ at_rest
    amplitudes[::2, 1:] = -w.gaps * at_rest
    amplitudes[1::2, 1:] = w.gaps * z
    return amplitudes, np.append(-1j, -w.beta - 1j)


@in_digits
def noise(c, tau, t):
    """The covariance that the noise adds in a flight."""
    time = mp.mpf(t)
    amplitudes, rates = _responses(c, mp.mpf(tau) + time)
    total = 0
    # Re f Re g = Re (f g + f g*) / 2
    for other, turned in ((amplitudes, rates), (amplitudes.conj(), rates.conj())):
        both = np.add.outer(rates, turned)
        integrals = np.where(both == 0, time, expm1(both * time) / np.where(both == 0, 1, both))
        total += amplitudes @ integrals @ other.T
    return real(mp.mpf(c.sigma) ** 2 / 2 * total).astype(float)


@in_digits
def step_noise(c, tau, h, increment, slope):
    """What the noise ``(increment + slope (s / h - 1/2)) / h`` at a time s of a step of length h
    adds to the state."""
    amplitudes, rates = _responses(c, mp.mpf(tau) + mp.mpf(h))
    plain = expm1(rates * h) / rates
    first = (h * exp(rates * h) - plain) / rates  # of the lag
    added = amplitudes @ ((increment + slope / 2) * plain - slope / h * first)
    return real(added).astype(float) * c.sigma / h


@in_digits
def window_integrals(low, high, order):
    """``int z^n phi(z) dz`` and ``int |z|^n phi(z) dz`` over a window, for every n up to an
    order."""
    n = np.arange(order + 1)
    half = exact(n) / 2

    def whole(z):
        """Of ``|z|^n phi(z)``, from 0."""
        signed = mp.sign(z) / mp.sqrt(4 * mp.pi)
        return 2**half * [mp.gammainc(a, 0, z * z / 2) for a in half + 0.5] * signed

    below = whole(mp.mpf(low))
    above = whole(mp.mpf(high))
    return mp.sign(high) ** n * above - mp.sign(low) ** n * below, above - below
