"""One scalar step of the Euler scheme as an affine map, and its moments after many steps, without sampling."""

import numpy as np

from rattle.montecarlo.schemes.euler import euler_step, step_forcing


def affine_step(scene, tau, h):
    """Matrix, shift and kick of one Euler step, read off the product's scalar function."""
    c = scene.constants
    f = step_forcing(c, tau, h)
    shift = np.array(euler_step(c, f, h, 0.0, 0.0, 0.0, 0.0, 0.0))
    matrix = np.array([euler_step(c, f, h, *e, 0.0) for e in np.eye(4)]).T - shift[:, None]
    kick = np.array(euler_step(c, f, h, 0.0, 0.0, 0.0, 0.0, 1.0)) - shift
    return matrix, shift, kick


def by_steps(scene, t, h):
    """Mean and covariance at time t after the start: exact moments of the scheme, no sampling."""
    s = scene.start
    mean, cov = np.array([s.x1, s.y1, s.x2, s.y2]), np.zeros((4, 4))
    for n in range(round(t / h)):
        matrix, shift, kick = affine_step(scene, s.tau + n * h, h)
        mean, cov = matrix @ mean + shift, matrix @ cov @ matrix.T + np.outer(kick, kick)
    return mean, cov
