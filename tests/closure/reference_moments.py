"""Moment equations of one stage (Eqs. 14, 16), integrated numerically."""

from itertools import product

import numpy as np
from scipy.integrate import solve_ivp


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
