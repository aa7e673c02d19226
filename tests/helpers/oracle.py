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

import numpy as np
from scipy.integrate import solve_ivp

from rattle import Order

SINE = (Order(1),)
PRECISE = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14}


class Gearbox:
    """The wheels of a scene's constants in gap coordinates:
    ``y' = drag - damping y + (alpha + sigma eta) m(tau)``.

    ``effect[:, i]`` is what a push in mesh i does to all rates, in units of what it does to its
    own.  States are ``(x1, y1, x2, y2, ...)``.
    """

    def __init__(self, c, drive=SINE):
        wheels = c.wheels
        self.alpha = c.alpha
        self.sigma = c.sigma
        self.drive = drive
        self.epsilon = wheels["epsilon"]
        self.gaps = wheels["wall"]
        self.lows = wheels["low"]  # the walls on the other side
        self.springs = np.diag(wheels["stiffness"])
        one = np.eye(wheels.size)
        at_driver = wheels["parent"] < 0
        ratio = np.where(at_driver, 0.0, wheels["ratio"])
        self.to_gaps = wheels["sign"][:, None] * (one - ratio[:, None] * one[wheels["parent"]])
        from_gaps = np.linalg.inv(self.to_gaps)
        kappa = from_gaps @ (wheels["sign"] * wheels["ratio"] * at_driver)
        self.damping = self.to_gaps @ np.diag(wheels["beta"]) @ from_gaps
        self.drag = self.to_gaps @ wheels["gamma"]
        self.own = self.to_gaps @ (wheels["own"] != 0.0)
        self.by_second = self.to_gaps @ kappa  # m = by_second f'' + by_first f'
        self.by_first = self.to_gaps @ (wheels["beta"] * kappa)
        contact = self.to_gaps @ np.diag(1.0 / wheels["mass"]) @ self.to_gaps.T
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

    def acceleration(self, tau, y):
        """y' without noise and springs."""
        return self.drag - self.damping @ y + self.alpha * self.modulation(tau)

    def rates(self, tau, state):
        """Right-hand side of Eq. 5 without noise."""
        x, y = np.reshape(state, (-1, 2)).T
        return np.column_stack([y, self.acceleration(tau, y) - self.springs @ x]).ravel()

    def noise_direction(self, tau):
        """What a unit of the noise adds to the state."""
        acting = self.own if self.own.any() else self.modulation(tau)
        return np.kron(acting, [0.0, 1.0])

    def restitution(self, mesh):
        """The matrix of an impact at a mesh (1, 2, ...; 0 for none), which acts on states."""
        matrix = np.eye(2 * self.gaps.size)
        if mesh:
            i = mesh - 1
            matrix[1::2, 2 * i + 1] -= (1.0 + self.epsilon[i]) * self.effect[:, i]
        return matrix

    def saltation(self, mesh, tau, before):
        """What an impact makes of the differences of neighbours at one time."""
        i = 2 * (mesh - 1)
        jump = self.restitution(mesh)
        begun, left = (self.rates(tau, state) for state in (before, jump @ before))
        jump[:, i] += (left - jump @ begun) / begun[i]
        return jump

    def contact_forces(self, tau, state, closed):
        """Pushes that keep the meshes of a mask closed, in units of their effect, and y' with
        them."""
        free = self.acceleration(tau, state[1::2])
        push = np.zeros(free.size)
        push[closed] = np.linalg.solve(self.effect[np.ix_(closed, closed)], -free[closed])
        return push, free + self.effect @ push

    def fly(self, tau, state, t, **settings):
        """State after a flight of time t without noise, or with ``settings`` scipy's solution."""
        run = solve_ivp(self.rates, (tau, tau + t), state, **PRECISE, **settings)
        return run if settings else run.y[:, -1]

    def largest_error(self, orbit):
        """The largest difference of an orbit's states before and after its impacts, and how far the
        flights between them are beyond a wall."""
        errors = []
        for mesh, before, after in zip(orbit.mesh, orbit.before, orbit.after, strict=True):
            errors.append(abs(self.restitution(mesh) @ before - after).max())
        for k in range(orbit.found):
            run = self.fly(orbit.tau[k], orbit.after[k], orbit.flight[k + 1], dense_output=True)
            errors.append(abs(run.y[:, -1] - orbit.before[k + 1]).max())
            times = np.linspace(*orbit.tau[k : k + 2], 60 + int(orbit.flight[k + 1] / 0.02))
            x = run.sol(times)[::2].T
            errors.append(np.maximum(x - self.gaps, -x - self.lows).max())
        return max(errors)

    def covariance(self, tau, cov, t, memory=0.0):
        """Covariance after a flight, ``P' = A P + P A' + sigma^2 m m'``; noise with a memory is
        stationary at its start and one more variable of the system."""
        size = len(cov)
        whole = size + bool(memory)
        drift, start, diffusion = np.zeros((3, whole, whole))
        drift[:size:2, 1:size:2] = np.eye(self.gaps.size)
        drift[1:size:2, :size:2] = -self.springs
        drift[1:size:2, 1:size:2] = -self.damping
        start[:size, :size] = cov
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
        tolerances = PRECISE | {"atol": 1e-14 * scale}
        run = solve_ivp(growth, (tau, tau + t), start.ravel(), **tolerances)
        return run.y[:, -1].reshape(whole, whole)[:size, :size]


gearbox = Gearbox


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
        mesh = orbit.mesh[k]
        jump = box.saltation(mesh, end, orbit.before[k]) if bends else box.restitution(mesh)
        spread = jump @ spread @ jump.T
    return np.array(middles), np.array(ends)
