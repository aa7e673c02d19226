"""The linearised path as a control variate: first order in the noise, driven by the path's own
noise.

A perturbation of the noise-free orbit obeys the linear flight, and at each impact the saltation
matrix (docs/model.md section 6); at a path's own impact it changes the time by ``-xi_i / y_i`` and
the state by ``(I - F- g' / (g' F-)) xi``. Step by step this is a linear map of the normals: its
mean is zero and its variance is known without sampling, so it never adds a bias, however bad the
approximation is.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.noise.philox import Word
from rattle.montecarlo.schemes.lanes import add_scaled
from rattle.montecarlo.schemes.short_flight import pushed_by
from rattle.montecarlo.statistics.central_sums import CentralSums
from rattle.montecarlo.statistics.section_statistics import undefined
from rattle.scene import Bools, Constants, Floats, Ints, Scene
from rattle.scene.compiled import lean_internal
from rattle.scene.flight import field, jacobian
from rattle.scene.impact import slowest_impact
from rattle.scene.linear_algebra import product, transform
from rattle.scene.orbit import follow
from rattle.scene.tangent import land, saltation_matrix

MOST_LINEAR_STEPS = 100_000  # of the linearised path; later impacts have no control variate
FEWEST_OF_A_REGRESSION = 32  # paths of a regression; with three its residuals would be zero


class LinearPath(NamedTuple):
    """The linearised path as a sequence of linear maps, one for each step, for compiled code.

    The perturbation has 2 wheels + 1 components: of the state, and of the time of the last impact.
    """

    carry: Floats  # propagator of the perturbation over a step; (steps, components, components)
    noise: Floats  # effect of the two standard normals of a step; (steps, 2, components)
    # step in which the orbit has each impact; impacts that it does not have are left out;
    # (impacts,)
    at_step: Ints
    # read, read_noise: from the perturbation at the start of that step, and from its normals, to
    # the section quantities; (impacts, quantities, components) and (impacts, 2, quantities)
    read: Floats
    read_noise: Floats
    # of the section quantities; zero at impacts that the orbit does not have; (all impacts,
    # quantities)
    variance: Floats


def no_control() -> LinearPath:
    """A linearised path without steps and impacts: no control variate."""
    return _blank_path(0, 0, 0, 1)


def _blank_path(steps: int, known: int, impacts: int, wheels: int) -> LinearPath:
    """A linearised path to be filled, of so many steps and impacts of the orbit."""
    size = 2 * wheels + 1
    quantities = 2 * wheels + 2
    return LinearPath(
        carry=np.empty((steps, size, size)),
        noise=np.empty((steps, 2, size)),
        at_step=np.empty(known, np.int64),
        read=np.empty((known, quantities, size)),
        read_noise=np.empty((known, 2, quantities)),
        variance=np.zeros((impacts, quantities)),
    )


class LinearImpact(NamedTuple):
    """An impact of the orbit, as linear maps of the perturbation and of the time of the impact
    before."""

    tau: float
    read: Floats  # to the section quantities; (quantities, components)
    carry: Floats  # to the perturbation after it; (components, components)


def orbit_impacts(scene: Scene, impacts: int) -> list[LinearImpact]:
    """The orbit's impacts, until it grazes, sticks or ends."""
    c = scene.constants
    orbit = follow(scene, impacts).until_sticking
    slowest = slowest_impact(c, orbit.after[0])
    linear = []
    for k in range(1, orbit.found + 1):
        mesh = orbit.mesh[k]
        tau = orbit.tau[k]
        before = orbit.before[k]
        if abs(before[2 * mesh - 1]) < slowest:
            break
        size = before.size
        landed = np.eye(size)
        late = land(field(c, tau, before), 2 * (mesh - 1), landed)
        read = np.zeros((size + 2, size + 1))
        read[:2, :size] = late
        read[1, size] = -1.0
        read[2:, :size] = landed
        carry = np.zeros((size + 1, size + 1))
        carry[:size, :size] = saltation_matrix(c, mesh, tau, before)
        carry[size, :size] = late
        linear.append(LinearImpact(float(tau), read, carry))
    return linear


def _flight(c: Constants, tau: float, begin: float, h: float, span: float) -> tuple[Floats, Floats]:
    """Propagator over a part of a step of length h, from `begin` for `span`, and the effect of the
    step's normals."""
    size = 2 * c.wheels.size
    carry = np.eye(size + 1)
    noise = np.zeros((2, size + 1))
    carry[:size, :size] = jacobian(c, span)
    part = span / h
    area = np.sqrt(h / 12.0)
    along = area * part
    inside = 12.0 * along * ((begin + 0.5 * span) / h - 0.5)
    noise[0, :size] = pushed_by(c, tau + begin, span, np.sqrt(h) * part, 0.0)
    noise[1, :size] = pushed_by(c, tau + begin, span, inside, along * part)
    return carry, noise


@lru_cache(maxsize=2)  # consecutive runs often share a scene, and many steps take seconds
def linear_path(scene: Scene, impacts: int, dt: float) -> LinearPath:
    """The linearised path of a scene at a step."""
    c = scene.constants
    orbit = [
        impact
        for impact in orbit_impacts(scene, impacts)
        if impact.tau - scene.phase < MOST_LINEAR_STEPS * dt
    ]
    steps = int((orbit[-1].tau - scene.phase) / dt) + 1 if orbit else 0
    program = _blank_path(steps, len(orbit), impacts, scene.stages)
    size = 2 * scene.stages + 1
    covariance = np.zeros((size, size))
    k = 0
    for n in range(steps):
        tau = scene.phase + n * dt
        at = 0.0
        carry = np.eye(size)
        noise = np.zeros((2, size))
        first = k
        while k < len(orbit) and (
            orbit[k].tau < tau + dt or n == steps - 1
        ):  # the last in spite of rounding
            span = orbit[k].tau - tau - at
            linear, pushed = _flight(c, tau, at, dt, span)
            carry = product(linear, carry)
            noise = product(noise, linear.T) + pushed
            program.at_step[k] = n
            program.read[k], program.read_noise[k] = (
                product(orbit[k].read, carry),
                product(noise, orbit[k].read.T),
            )
            program.variance[k] = np.diagonal(transform(program.read[k], covariance))
            program.variance[k] += (program.read_noise[k] ** 2).sum(axis=0)
            carry = product(orbit[k].carry, carry)
            noise = product(noise, orbit[k].carry.T)
            at = at + span
            k = k + 1
        linear, pushed = _flight(c, tau, at, dt, dt - at)
        if k > first:
            linear, pushed = product(linear, carry), product(noise, linear.T) + pushed
        program.carry[n] = linear
        program.noise[n] = pushed
        drawn = program.noise[n]
        covariance = transform(program.carry[n], covariance) + sum(
            np.multiply.outer(v, v) for v in drawn
        )
    return program


@lean_internal
def _map_lanes(
    factors: Floats, noise: Floats, xi: Floats, w: Floats, area: Floats, out: Floats, live: int
) -> None:
    """Write a linear map of the perturbations and of the normals of a step, for all lanes.

    Shapes: `factors` (components,); `noise` (2,); `out` (lanes,).
    """
    for p in range(live):
        out[p] = noise[0] * w[p] + noise[1] * area[p]
    for j in range(factors.size):
        if factors[j] != 0.0:
            add_scaled(out, factors[j], xi[j], live)


@lean_internal
def carry_along(
    path: LinearPath,
    n: int,
    done: int,
    first: int,
    numbers: NDArray[Word],
    xi: Floats,
    w: Floats,
    area: Floats,
    controls: Floats,
    live: int,
) -> int:
    """Carry the perturbations of all lanes through step n.

    Shapes: `numbers` (lanes,); `xi` (2 components, lanes), of which the second half is scratch;
    `w`, `area` (lanes,); `controls` (paths, impacts, columns).
    """
    while done < path.at_step.size and path.at_step[done] == n:
        read = path.read[done]
        noise = path.read_noise[done]
        out = xi[read.shape[1]]
        for i in range(read.shape[0]):
            _map_lanes(read[i], noise[:, i], xi, w, area, out, live)
            for p in range(live):
                controls[int(numbers[p]) - first, done, i] = out[p]
        done += 1
    if done < path.at_step.size:
        carry = path.carry[n]
        noise = path.noise[n]
        size = carry.shape[0]
        for i in range(size):
            _map_lanes(carry[i], noise[:, i], xi, w, area, xi[size + i], live)
        for i in range(size):
            for p in range(live):
                xi[i, p] = xi[size + i, p]
    return done


def estimate_controlled(sums: CentralSums, variance: Floats) -> dict[str, Floats]:
    """Mean and sd of a quantity with standard errors, by regression on a control variate of known
    variance.

    The quantity and its square are regressed on the control variate l and on ``l^2``, whose
    expectations are known (Glasserman 2003, section 4.1), but not in cells where l does not vary,
    which some paths have not reached, or which fewer than `FEWEST_OF_A_REGRESSION` have.  Nor where
    that gives something impossible, as it may with few paths: a variance that is not positive, or
    (then for all times and flights together) mean impact times out of order or negative mean
    flights.

    `sums`: Of the quantity (first) and the control variate (second), orders `PAIR`, shape (impacts,
    section quantities). Shapes: `variance` (impacts, quantities); result (impacts,
    quantities).
    """
    n = sums.n
    m = sums.moment
    reached = n == n.max()
    usable = (variance > 0.0) & reached & (n >= FEWEST_OF_A_REGRESSION) & (m(0, 2) > 0.0)
    with undefined():
        m02 = m(0, 2)
        m03 = m(0, 3)
        m20 = m(2, 0)
        m04 = m(0, 4) - m02**2
        determinant = m02 * m04 - m03**2
        usable &= determinant > 0.0
        determinant = np.where(usable, determinant, np.nan)
        # expectations of l, and of its square about the sample mean, less their sample means
        off = -sums.mean[1]
        off_square = variance + sums.mean[1] ** 2 - m02

        def regress(g1: Floats, g2: Floats, spread: Floats) -> tuple[Floats, Floats]:
            b1 = (m04 * g1 - m03 * g2) / determinant
            b2 = (m02 * g2 - m03 * g1) / determinant
            return b1 * off + b2 * off_square, np.maximum(spread - b1 * g1 - b2 * g2, 0.0)

        square = m(4, 0) - m20**2
        shift, left = regress(m(1, 1), m(1, 2), m20)
        change, left_square = regress(m(2, 1), m(2, 2) - m20 * m02, square)
        usable &= m20 + change - shift**2 > 0.0
        usable[:, :2] &= _in_order(sums.mean[0] + np.where(usable, shift, 0.0), reached)
        shift = np.where(usable, shift, 0.0)
        change = np.where(usable, change, 0.0)
        se_mean = np.sqrt(np.where(usable, left, np.maximum(m20, 0.0)) / n)
        se_square = np.sqrt(np.where(usable, left_square, np.maximum(square, 0.0)) / n)
        sd = np.sqrt(np.maximum(m20 + change - shift**2, 0.0))
        return {
            "mean": np.where(n > 0, sums.mean[0] + shift, np.nan),
            "se_mean": se_mean,
            "sd": sd,
            "se_sd": np.where(sd > 0.0, se_square / (2.0 * sd), 0.0 * sd),
        }


def _in_order(mean: Floats, reached: Bools) -> bool:
    """Whether mean impact times ascend and no mean flight is negative, over the impacts that all
    paths have reached."""
    tau = mean[reached[:, 0], 0]
    flight = mean[reached[:, 1], 1]
    return bool((np.diff(tau) >= 0.0).all() and (flight >= 0.0).all())
