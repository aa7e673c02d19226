"""Moment equations of one stage (Eqs. 14, 16), integrated numerically, and the window of Eqs. 20,
21."""

from math import pi, sqrt

import numpy as np
from scipy.integrate import solve_ivp


def stage_moments_after_flight(raw, beta, tau, t, intensity):
    """Eqs. 14 and 16: raw moments E[xi^n zeta^p] of one stage, by their hierarchy; `intensity(tau)`
    is sigma^2 m^2."""
    n, p = np.indices(raw.shape)

    def rate(time, flat):
        m = flat.reshape(raw.shape)
        rates = -beta * p * m
        rates[1:, :-1] += n[1:, :-1] * m[:-1, 1:]
        rates[:, 2:] += intensity(time) * (0.5 * p * (p - 1))[:, 2:] * m[:, :-2]
        return rates.ravel()

    # fourth moments of a weak noise are as small as the absolute tolerance
    settings = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-20}
    run = solve_ivp(rate, (tau, tau + t), raw.ravel(), **settings)
    return run.y[:, -1].reshape(raw.shape) * (n + p < len(raw))


def window_shift(raw, x, half_window):
    """sigma A and sigma B of Eqs. 20, 21 to fourth order, +psi_0 as published; 0 unless variances
    are positive."""
    if not (raw[2, 0] > 0 and raw[0, 2] > 0):
        return 0.0, 0.0
    sx = sqrt(raw[2, 0])
    sy = sqrt(raw[0, 2])
    powers = np.arange(5)
    raw = raw / np.outer(sx**powers, sy**powers)
    edges = (np.array([-half_window, half_window]) - x) / sx
    psi = edges[:, None] ** powers * np.exp(-(edges**2) / 2)[:, None] / sqrt(2 * pi)
    psi = psi[0] - psi[1]
    rho = raw[1, 1]
    a30 = raw[3, 0] / 6
    a40 = (raw[4, 0] - 3) / 24
    a21 = raw[2, 1] / 2
    a31 = (raw[3, 1] - 3 * rho) / 6
    shift_x = psi[0] + a30 * psi[3] + a40 * (psi[4] - 2 * psi[2] + psi[0])
    shift_y = rho * psi[0] + a21 * psi[1] + a31 * (psi[2] - psi[0])
    return sx * shift_x, sy * shift_y
