"""Reference values in 400 digits, from the formulas of docs/model.md sections 2, 3 and 6 as they
stand there.

A flight is written as a sum of exponentials with divisions by beta: with so many digits,
cancellation does not matter, and beta = 0 can be replaced by 1e-30.  No function of
`rattle.scene.flight` is used.  Needs mpmath.
"""

from collections import defaultdict
from collections.abc import Callable
from functools import cache
from typing import Any, TypeVar

import mpmath as mp

from rattle.scene import Constants

F = TypeVar("F", bound=Callable[..., Any])
Sum = dict[tuple[int, int, int], Any]
"""``sum c exp((-n beta_1 - m beta_2 + i k) t)`` by ``(n, m, k)``."""

DIGITS = 400
NIL = "1e-30"


def in_digits(function: F) -> F:
    """Decorate a function so that it computes with `DIGITS` decimal digits."""
    precise: F = mp.workdps(DIGITS)(function)
    return precise


def _betas(c: Constants) -> tuple[Any, Any]:
    return mp.mpf(c.beta1 or NIL), mp.mpf(c.beta2 or NIL)


def _phi1(beta: Any, t: Any) -> Any:
    return -mp.expm1(-beta * t) / beta


@in_digits
def flight(
    c: Constants, tau: float, y1: float, y2: float, t: float
) -> tuple[list[float], list[float]]:
    """Compute the state after a flight.

    Returns: Changes of x1 and x2 and new values of y1 and y2, in the order x1, y1, x2, y2; and the
    sum of the absolute values of their terms.
    """
    b1, b2 = _betas(c)
    a, g1, g2, tau, t = (mp.mpf(v) for v in (c.alpha, c.gamma1, c.gamma2, tau, t))
    u1 = a * mp.cos(tau) - y1
    u2 = u1 + y2
    e1 = _phi1(b1, t)
    e2 = _phi1(b2, t)
    d1 = mp.exp(-b1 * t)
    d2 = mp.exp(-b2 * t)
    drag1 = (t - e1) / b1
    drag2 = (t - e2) / b2
    s1 = u1 * e1 - g1 * drag1
    s2 = u2 * e2 - g2 * drag2
    v1 = u1 * d1 - g1 * e1
    v2 = u2 * d2 - g2 * e2
    driven = mp.sin(tau + t) - mp.sin(tau)
    values = a * driven - s1, a * mp.cos(tau + t) - v1, s2 - s1, v2 - v1
    sine = abs(mp.sin(tau))
    cosine = abs(mp.cos(tau))
    most = abs(a * mp.cos(tau)) + abs(y1)
    sizes = (
        abs(y1) * e1 + g1 * drag1 + a * (cosine * abs(mp.sin(t) - e1) + sine * (1 - mp.cos(t))),
        abs(y1) * d1 + g1 * e1 + a * (cosine * (b1 * e1 + (1 - mp.cos(t))) + sine * abs(mp.sin(t))),
        abs(y2) * e2 + most * abs(e1 - e2) + g1 * drag1 + g2 * drag2,
        abs(y2) * d2 + most * abs(d1 - d2) + g1 * e1 + g2 * e2,
    )
    return [float(v) for v in values], [float(v) for v in sizes]


@in_digits
def jacobian(c: Constants, t: float) -> list[list[float]]:
    """Compute the Jacobian of a flight, ``exp(A t)``.

    Shapes: result (4, 4).
    """
    b1, b2 = _betas(c)
    time = mp.mpf(t)
    e1 = _phi1(b1, time)
    e2 = _phi1(b2, time)
    d1 = mp.exp(-b1 * time)
    d2 = mp.exp(-b2 * time)
    rows = [[1, e1, 0, 0], [0, d1, 0, 0], [0, e1 - e2, 1, e2], [0, d1 - d2, 0, d2]]
    return [[float(v) for v in row] for row in rows]


def _product(one: Sum, other: Sum) -> Sum:
    out: Sum = defaultdict(mp.mpf)
    for (n, m, k), a in one.items():
        for (p, q, r), b in other.items():
            out[n + p, m + q, k + r] += a * b
    return out


def _combine(*terms: tuple[Any, Sum]) -> Sum:
    """The linear combination of sums with their factors."""
    out: Sum = defaultdict(mp.mpf)
    for factor, term in terms:
        for key, value in term.items():
            out[key] += factor * value
    return out


def _responses(c: Constants, end: Any) -> list[Sum]:
    """Responses of ``(x1, y1, x2, y2)`` at the phase `end` to a unit impulse of noise, as functions
    of the lag."""
    b1, b2 = _betas(c)
    one = mp.expj(end) / 2
    back = mp.expj(-end) / 2
    cosine: Sum = {(0, 0, -1): one, (0, 0, 1): back}
    sine: Sum = {(0, 0, -1): -1j * one, (0, 0, 1): 1j * back}
    m1 = _combine((-1, sine), (b1, cosine))
    rest = _combine((b1 - b2, cosine), (-1, m1))
    d1: Sum = {(1, 0, 0): mp.mpc(1)}
    d2: Sum = {(0, 1, 0): mp.mpc(1)}
    e1: Sum = {(0, 0, 0): 1 / b1, (1, 0, 0): -1 / b1}
    e2: Sum = {(0, 0, 0): 1 / b2, (0, 1, 0): -1 / b2}
    x2, y2 = (
        _combine((1, _product(one, m1)), (1, _product(two, rest)))
        for one, two in ((e1, e2), (d1, d2))
    )
    return [_product(e1, m1), _product(d1, m1), x2, y2]


@in_digits
def unit_noise(c: Constants, end: float, lag: float) -> list[float]:
    """Compute the response of the state to a unit impulse of noise."""
    b1, b2 = _betas(c)
    time = mp.mpf(lag)
    return [
        float(
            mp.re(sum(v * mp.exp((-n * b1 - m * b2 + 1j * k) * time) for (n, m, k), v in g.items()))
        )
        for g in _responses(c, mp.mpf(end))
    ]


@in_digits
def noise(c: Constants, tau: float, t: float) -> list[list[float]]:
    """Compute the covariance that the noise adds in a flight.

    Shapes: result (4, 4).
    """
    b1, b2 = _betas(c)
    time = mp.mpf(t)
    g = _responses(c, mp.mpf(tau) + time)

    @cache
    def integral(n: int, m: int, k: int) -> Any:
        rate = -n * b1 - m * b2 + 1j * k
        return mp.expm1(rate * time) / rate if rate != 0 else time

    square = mp.mpf(c.sigma) ** 2
    return [
        [
            float(mp.re(square * sum(v * integral(*k) for k, v in _product(one, other).items())))
            for other in g
        ]
        for one in g
    ]


@in_digits
def saltation(
    c: Constants, mesh: int, tau: float, y1: float, y2: float
) -> tuple[list[list[float]], ...]:
    """Compute the saltation matrix ``R + (F+ - R F-) g' / (g' F-)`` of docs/model.md section 6.

    Returns: The matrix, and for each entry the sum of the absolute values of its terms. Shapes:
    result (4, 4).
    """
    a = mp.mpf(c.alpha)
    eps = mp.mpf(c.epsilon)
    mu = mp.mpf(c.mu)
    restitution = mp.eye(4)
    if mesh == 1:
        restitution[1, 1] = -eps
        restitution[3, 1] = -(1 + eps)
    else:
        restitution[1, 3] = -(1 + eps) * mu
        restitution[3, 3] = -eps

    def rate(s: Any) -> tuple[Any, Any]:
        u1 = a * mp.cos(tau) - s[1]
        u2 = u1 + s[3]
        pulls = c.beta1 * u1 + mp.mpf(c.gamma1), c.beta2 * u2 + mp.mpf(c.gamma2)
        most = abs(a * mp.cos(tau)) + abs(s[1])
        size = c.beta1 * most + c.gamma1, c.beta2 * (most + abs(s[3])) + c.gamma2
        value = mp.matrix([s[1], -a * mp.sin(tau) + pulls[0], s[3], pulls[0] - pulls[1]])
        return value, mp.matrix(
            [abs(s[1]), abs(a * mp.sin(tau)) + size[0], abs(s[3]), size[0] + size[1]]
        )

    before = mp.matrix([0, mp.mpf(y1), 0, mp.mpf(y2)])
    f, f_size = rate(before)
    h, h_size = rate(restitution * before)
    absolute = restitution.apply(abs)
    j = 2 * (mesh - 1)
    jump = (h - restitution * f) / f[j]
    size = (h_size + absolute * f_size) / abs(f[j])
    for i in range(4):
        restitution[i, j] += jump[i]
        absolute[i, j] += size[i]
    return tuple(
        [[float(matrix[i, k]) for k in range(4)] for i in range(4)]
        for matrix in (restitution, absolute)
    )


@in_digits
def normal_integrals(low: float, high: float, order: int) -> tuple[list[Any], list[Any]]:
    """Compute ``int z^n phi(z) dz`` and ``int |z|^n phi(z) dz`` over a window, by parts from the
    error function."""

    def upwards(a: Any, b: Any) -> list[Any]:
        edges = [mp.exp(-z * z / 2) / mp.sqrt(2 * mp.pi) for z in (a, b)]
        out = [(mp.erfc(a / mp.sqrt(2)) - mp.erfc(b / mp.sqrt(2))) / 2]
        for n in range(1, order + 1):
            out.append(
                a ** (n - 1) * edges[0]
                - b ** (n - 1) * edges[1]
                + ((n - 1) * out[n - 2] if n > 1 else 0)
            )
        return out

    a = mp.mpf(low)
    b = mp.mpf(high)
    zero = mp.mpf(0)
    # of |z|, over the parts of the window on either side of 0
    below = upwards(max(-b, zero), max(-a, zero))
    above = upwards(max(a, zero), max(b, zero))
    return (
        [r + (-1) ** n * v for n, (v, r) in enumerate(zip(below, above, strict=True))],
        [v + r for v, r in zip(below, above, strict=True)],
    )


@in_digits
def phase(tau: float) -> float:
    """Reduce a time to the phase in [-pi, pi], with 400 digits of pi."""
    turn = 2 * mp.pi
    return float(mp.mpf(tau) - turn * mp.nint(mp.mpf(tau) / turn))
