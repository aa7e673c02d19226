"""Moment equations integrated numerically: of one stage (Eqs. 14, 16), and joint ones of any linear system."""

from itertools import product

import numpy as np
from reference_dynamics import contact, covariance_flight, drift_matrix, first_crossing, fly, modulation
from scipy.integrate import solve_ivp

__all__ = [
    "JointMoments",
    "contact",
    "covariance_flight",
    "drift_matrix",
    "first_crossing",
    "fly",
    "modulation",
    "stage_moments_after_flight",
]


def stage_moments_after_flight(raw, beta, tau, t, intensity):
    """Eqs. 14 and 16: raw moments E[xi^n zeta^p] of one stage, by their hierarchy; `intensity(tau)` is sigma^2 m^2."""
    order = raw.shape[0] - 1
    entries = [(n, p) for n, p in product(range(order + 1), repeat=2) if n + p <= order]
    index = {entry: i for i, entry in enumerate(entries)}
    drift, noise = np.zeros((2, len(entries), len(entries)))
    for (n, p), i in index.items():
        if n:
            drift[i, index[n - 1, p + 1]] += n
        drift[i, i] -= beta * p
        if p > 1:
            noise[i, index[n, p - 2]] += 0.5 * p * (p - 1)
    start = np.array([raw[entry] for entry in entries])
    run = solve_ivp(
        lambda time, m: drift @ m + intensity(time) * (noise @ m), (tau, tau + t), start,
        method="DOP853", rtol=1e-12, atol=1e-20,  # fourth moments of a weak noise are that small
    )  # fmt: skip
    out = np.zeros_like(raw)
    for entry, i in index.items():
        out[entry] = run.y[i, -1]
    return out


class JointMoments:
    """E[z^a] up to a total degree `order`, of dz = (A z) dt + g(tau) dW with linear jumps."""

    def __init__(self, order, size=4):
        self.size = size
        self.powers = [a for a in product(range(order + 1), repeat=size) if sum(a) <= order]
        self.index = {a: i for i, a in enumerate(self.powers)}

    def zero(self):
        """Moments of the point mass at 0."""
        values = np.zeros(len(self.powers))
        values[self.index[(0,) * self.size]] = 1.0
        return values

    def _moved(self, a, down, up=()):
        b = list(a)
        for i in down:
            b[i] -= 1
        for i in up:
            b[i] += 1
        return self.index[tuple(b)]

    def fly(self, moments, a_matrix, g, tau, t):
        """Integrate d E[z^a]/dt = sum A_ij a_i E[z^(a-i+j)] + 1/2 sum g_i g_j a_i (a_j - d_ij) E[z^(a-i-j)]."""
        n = len(self.powers)
        drift, pairs = np.zeros((n, n)), {}
        for a, row in self.index.items():
            for i, j in product(range(self.size), repeat=2):
                if a[i] and a_matrix[i, j]:
                    drift[row, self._moved(a, [i], [j])] += a_matrix[i, j] * a[i]
                factor = a[i] * (a[j] - (i == j))
                if factor > 0:
                    pairs.setdefault((i, j), np.zeros((n, n)))[row, self._moved(a, [i, j])] += 0.5 * factor
        used = [i for i in range(self.size) if g(tau)[i] or g(tau + 0.1)[i]]

        def rate(time, m):
            amplitude = g(time)
            return drift @ m + sum(amplitude[i] * amplitude[j] * (pairs[i, j] @ m) for i, j in product(used, used))

        run = solve_ivp(rate, (tau, tau + t), moments, method="DOP853", rtol=1e-11, atol=1e-13)
        return run.y[:, -1]

    def jump(self, moments, matrix):
        """Moments of R z: each (R z)^a expanded into monomials of z."""
        out = np.zeros_like(moments)
        for a, row in self.index.items():
            polynomial = {(0,) * self.size: 1.0}
            for i in range(self.size):
                for _ in range(a[i]):
                    grown = {}
                    for b, value in polynomial.items():
                        for j in np.flatnonzero(matrix[i]):
                            higher = (*b[:j], b[j] + 1, *b[j + 1 :])
                            grown[higher] = grown.get(higher, 0.0) + value * matrix[i, j]
                    polynomial = grown
            out[row] = sum(value * moments[self.index[b]] for b, value in polynomial.items())
        return out

    def gaussian(self, covariance):
        """Isserlis: E[z_i z^b] = sum_j C_ij b_j E[z^(b-j)]."""
        out = self.zero()
        for a in sorted(self.powers, key=sum):
            if sum(a) == 0:
                continue
            i = next(k for k in range(self.size) if a[k])
            b = (*a[:i], a[i] - 1, *a[i + 1 :])
            out[self.index[a]] = sum(
                covariance[i, j] * b[j] * out[self._moved(b, [j])] for j in range(self.size) if b[j]
            )
        return out

    def covariance(self, moments):
        """Second moments as a matrix."""
        unit = np.eye(self.size, dtype=int)
        return np.array([[moments[self.index[tuple(unit[i] + unit[j])]] for j in range(4)] for i in range(4)])
