"""The dynamics of a gearbox written a second time, for any tree of wheels or other bodies, with
numpy and scipy alone.

A wheel deviates from its nominal motion by z and v = z', at the radius of its own mesh; the noise
is all that wheels in flight have in common (f is the motion of the driver), or acts on one of them
alone, as ``sigma eta``; a spring holds a wheel at the driver::

    v' = gamma - beta v - stiffness z + kappa (alpha + sigma eta) (f'' + beta f')
    kappa = k kappa_parent

A mesh is a gap ``x = sign (z - k z_parent)`` with the rate y.  A push in it moves the wheel by its
mobility (one over its mass at that mesh) and the parent by -k times the parent's mobility.  The
paper's two stages are a chain of two wheels, with the sign of the second gap turned.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp


class Wheel(NamedTuple):
    """A wheel and its mesh with its parent; parent 0 is the driver, which nothing moves."""

    beta: float
    gamma: float
    mobility: float
    gap: float = 0.5
    parent: int = 0
    ratio: float = 1.0
    sign: float = 1.0
    epsilon: float = 0.9
    stiffness: float = 0.0
    low: float = math.nan  # the wall on the other side; by default as far as the first
    noisy: bool = False  # whether the noise acts on it alone


class Sine(NamedTuple):
    """An order of the drive, ``amplitude sin(order tau + phase)``."""

    order: int = 1
    amplitude: float = 1.0
    phase: float = 0.0


SINE = (Sine(),)


class Gearbox:
    """The wheels in gap coordinates: ``y' = drag - damping y + (alpha + sigma eta) m(tau)``.

    ``effect[:, i]`` is what a push in mesh i does to all rates, in units of what it does to its
    own.  States are ``(x1, y1, x2, y2, ...)``.
    """

    def __init__(self, wheels, alpha, sigma=0.0, drive=SINE):
        self.alpha = alpha
        self.epsilon = [wheel.epsilon for wheel in wheels]
        self.sigma = sigma
        self.drive = drive
        self.gaps = [wheel.gap for wheel in wheels]
        self.lows = [w.gap if math.isnan(w.low) else w.low for w in wheels]
        self.springs = np.array([wheel.stiffness for wheel in wheels])
        kappa = [1.0]
        to_gaps = np.zeros((len(wheels), len(wheels)))
        for i, wheel in enumerate(wheels):
            kappa.append(wheel.ratio * kappa[wheel.parent])
            to_gaps[i, i] = wheel.sign
            if wheel.parent:
                to_gaps[i, wheel.parent - 1] = -wheel.sign * wheel.ratio
        self.to_gaps = to_gaps
        beta = np.array([wheel.beta for wheel in wheels])
        self.damping = to_gaps @ np.diag(beta) @ np.linalg.inv(to_gaps)
        self.drag = to_gaps @ [wheel.gamma for wheel in wheels]
        self.own = to_gaps @ [float(wheel.noisy) for wheel in wheels]
        self.by_second = to_gaps @ kappa[1:]  # m = by_second f'' + by_first f'
        self.by_first = to_gaps @ (beta * kappa[1:])
        contact = to_gaps @ np.diag([wheel.mobility for wheel in wheels]) @ to_gaps.T
        self.effect = contact / np.diag(contact)

    def modulation(self, tau):
        """m(tau), what a unit of the noise adds to the rates; shape (wheels,) + that of tau."""
        first = 0.0
        second = 0.0
        for term in self.drive:
            angle = term.order * np.asarray(tau) + term.phase
            first = first + term.amplitude * term.order * np.cos(angle)
            second = second - term.amplitude * term.order**2 * np.sin(angle)
        return np.multiply.outer(self.by_second, second) + np.multiply.outer(self.by_first, first)

    def acceleration(self, tau, y, excitation=None):
        """y' where alpha + sigma eta has a value (alpha without noise); y has the shape of
        `modulation`."""
        excitation = self.alpha if excitation is None else excitation
        return (self.drag - (self.damping @ y).T).T + excitation * self.modulation(tau)

    def rates(self, tau, state):
        """Right-hand side of Eq. 5 without noise."""
        out = np.empty(len(state))
        out[::2] = state[1::2]
        x, y = np.reshape(state, (-1, 2)).T
        out[1::2] = self.acceleration(tau, y) - self.springs * x
        return out

    def drift_matrix(self):
        """A of the linear system s' = A s + ..."""
        of_rates = np.kron(-self.damping, [[0.0, 0.0], [0.0, 1.0]])
        of_places = np.kron(np.diag(-self.springs), [[0.0, 0.0], [1.0, 0.0]])
        return np.kron(np.eye(len(self.gaps)), [[0.0, 1.0], [0.0, 0.0]]) + of_rates + of_places

    def noise_direction(self, tau):
        """What a unit of the noise adds to the state."""
        acting = self.own if self.own.any() else self.modulation(tau)
        return np.kron(acting, [0.0, 1.0])

    def restitution(self, mesh):
        """The matrix of an impact at a mesh (1, 2, ...; 0 for none), which acts on states."""
        rates = np.eye(len(self.gaps))
        if mesh:
            rates[:, mesh - 1] -= (1.0 + self.epsilon[mesh - 1]) * self.effect[:, mesh - 1]
        return np.kron(np.eye(len(self.gaps)), [[1.0, 0.0], [0.0, 0.0]]) + np.kron(
            rates, [[0.0, 0.0], [0.0, 1.0]]
        )

    def contact_forces(self, tau, state, closed):
        """Pushes that keep the meshes of a mask closed, in units of their effect, and y' with
        them."""
        free = self.acceleration(tau, np.asarray(state[1::2]))
        push = np.zeros(len(self.gaps))
        chosen = np.flatnonzero(closed)
        push[chosen] = np.linalg.solve(self.effect[np.ix_(chosen, chosen)], -free[chosen])
        return push, free + self.effect @ push

    def fly(self, tau, state, t, **events):
        """State after a flight of time t without noise, or with ``events`` scipy's solution."""
        run = solve_ivp(
            self.rates, (tau, tau + t), state, method="DOP853", rtol=1e-12, atol=1e-14, **events
        )
        return run if events else run.y[:, -1]

    def first_crossing(self, tau, state, horizon, max_step=0.02):
        """(t, mesh, side, state) of the first outward crossing, or None; blind to excursions
        shorter than a step."""
        flanks = {1: self.gaps, -1: self.lows}
        walls = [
            (i, side)
            for i in range(len(self.gaps))
            for side, distance in flanks.items()
            if distance[i] < math.inf
        ]
        events = []
        for i, side in walls:

            def beyond(time, s, i=i, side=side):
                return side * s[2 * i] - flanks[side][i]

            beyond.terminal = True
            beyond.direction = 1.0
            events.append(beyond)
        run = self.fly(tau, state, horizon, events=events, max_step=max_step)
        for (i, side), times, states in zip(walls, run.t_events, run.y_events, strict=True):
            if times.size:
                return times[0] - tau, 1 + i, side, states[0]
        return None

    def covariance(self, tau, cov, t, memory=0.0):
        """Covariance after a flight, ``P' = A P + P A' + sigma^2 m m'``; noise with a memory is
        stationary at its start and one more variable of the system."""
        size = len(cov)
        whole = size + 1 if memory else size
        drift = np.zeros((whole, whole))
        drift[:size, :size] = self.drift_matrix()
        start = np.zeros((whole, whole))
        start[:size, :size] = cov
        diffusion = np.zeros((whole, whole))
        if memory:
            drift[size, size] = -1.0 / memory
            diffusion[size, size] = 1.0 / memory**2
            start[size, size] = 0.5 / memory

        def growth(time, flat):
            push = self.sigma * self.noise_direction(time)
            if memory:
                drift[:size, size] = push
            else:
                diffusion[:] = np.outer(push, push)
            spread = drift @ flat.reshape(whole, whole)
            return (spread + spread.T + diffusion).ravel()

        scale = max(self.sigma**2, float(np.abs(cov).max()), 1e-300)
        tolerances = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14 * scale}
        run = solve_ivp(growth, (tau, tau + t), start.ravel(), **tolerances)
        return run.y[:, -1].reshape(whole, whole)[:size, :size]


def gearbox(c, drive=SINE):
    """The gearbox of a scene's constants."""
    wheels = [
        Wheel(
            w.beta,
            w.gamma,
            1.0 / w.mass,
            w.wall,
            w.parent + 1,
            w.ratio,
            w.sign,
            w.epsilon,
            w.stiffness,
            w.low,
            bool(w.own),
        )
        for w in c.wheels
    ]
    return Gearbox(wheels, c.alpha, c.sigma, drive)


def follow_covariance(scene, orbit, bends=True):
    """Covariances of all paths in the middle of each flight and at its end; without the bend of
    neighbours' paths at an impact, as `corrected` has it and a negative control."""
    box = gearbox(scene.constants)
    size = orbit.before.shape[1]
    spread = np.zeros((size, size))
    middles = []
    ends = []
    for k in range(1, orbit.found + 1):
        begin, end = orbit.tau[k - 1 : k + 1]
        half = 0.5 * (end - begin)
        spread = box.covariance(begin, spread, half)
        middles.append(spread)
        spread = box.covariance(begin + half, spread, half)
        ends.append(spread)
        jump = box.restitution(orbit.mesh[k])
        if bends:
            i = 2 * orbit.mesh[k] - 2
            before, after = (box.rates(end, of[k]) for of in (orbit.before, orbit.after))
            jump[:, i] += (after - jump @ before) / before[i]
        spread = jump @ spread @ jump.T
    return np.array(middles), np.array(ends)
