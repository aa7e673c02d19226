"""What every closure returns, its moments just before each impact and between impacts, and the
bounds of their errors.

`branching` estimates its own error, without simulation, from signs that are added as independent
ones: the change from the next coarser level, the share of the squared impact speed that the noise
of one flight makes, what splitting the components further would be worth, how far they are bent and
taken as Gaussians, how well the weights of its branches are known, and the probability discarded
(docs/theory/closures.md).
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from rattle.scene import Bools, Floats, InputError, Ints, Scene
from rattle.scene.elementary import unknown
from rattle.scene.moments import fill_gaussian_moments


@dataclass(frozen=True, repr=False)
class Trace:
    """One closure followed through its impacts; index 0 of every array is the start.

    In the shapes below, quantities are the section quantities ``tau, flight, x1, y1, x2, y2, ...``:
    2 + 2 wheels.
    """

    # mean impact times in local time (`Scene.phase`); NaN beyond `found`; (impacts + 1,)
    tau: Floats
    mesh: Ints  # mesh, side: mesh and flank of each impact; 0 beyond `found`; (impacts + 1,)
    side: Ints
    # mean state just before the impact, ``x1, y1, x2, y2, ...``; (impacts + 1, 2 wheels)
    mean: Floats
    # predicted standard deviations of the section quantities; NaN where the closure predicts none,
    # or where its variance is negative; (impacts + 1, quantities)
    sd: Floats
    # skewness of the same; NaN where the closure predicts none, or where the cube of the sd
    # underflows; (impacts + 1, quantities)
    skew: Floats
    # covariance of the perturbation just before the impact; NaN where the closure has no such
    # moment; (impacts + 1, 2 wheels, 2 wheels)
    covariance: Floats
    # raw moments of the perturbation in each gap just before the impact; (impacts + 1, wheels,
    # order + 1, order + 1)
    raw: Floats
    # ``at(time) -> (mean, covariance)`` at a fixed local time between impacts
    at: Callable[[float], tuple[Floats, Floats]]
    found: int  # number of impacts that could be evaluated
    stopped: str  # why it ended early, or an empty string
    # components of the mixture at each impact, over the section quantities; None if the closure is
    # a single Gaussian
    parts: dict[int, tuple[Floats, Floats, Floats]] | None = None
    # last local time at which `at` can be evaluated; the mean time of the last impact by default
    until: float | None = None
    # agreement, discarded: predicted share of paths that have followed the orbit's itinerary so
    # far, and the probability discarded so far; of the branching closure only; (impacts + 1,)
    agreement: Floats | None = None
    discarded: Floats | None = None
    # mean, sd and skewness of the section quantities over these paths alone, by the same closure;
    # NaN where there are none; (3, impacts + 1, quantities)
    followed: Floats | None = None
    # the same closure's bounds of its own errors of mean and sd of the section quantities, in sds;
    # NaN where none is made; (impacts + 1, 2, quantities)
    error: Floats | None = None
    # the same closure's mean share of the squared impact speed that the noise of one flight makes;
    # (impacts + 1,)
    slow: Floats | None = None
    # the part of the variance of each section quantity that comes from slow impacts; (impacts + 1,
    # quantities)
    carried: Floats | None = None
    # what splitting its components further would be worth, by its own measure; (impacts + 1,)
    residual: Floats | None = None
    # the same, in sds of the section quantities: errors of mean and sd by those of the weights;
    # (impacts + 1, 2, quantities)
    doubted: Floats | None = None
    # the same closure's mean of what its components are bent, squared, and taken as Gaussians;
    # (impacts + 1,)
    bent: Floats | None = None
    # flights of components that the same closure computed, by impact; (impacts + 1,), of the others
    # (0,)
    flown: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    # mean flights, where they are not differences of mean times; (impacts + 1,)
    flight: Floats | None = None
    # of a closure of one's own: ``rho1, rho2, ...`` as it predicts them, (impacts + 1, wheels); the
    # seconds that it took; whether it raised an exception
    rho: Floats | None = None
    seconds: float = float("nan")
    raised: bool = False

    @property
    def wheels(self) -> int:
        """How many gaps, and wheels, it is of."""
        wheels: int = self.mean.shape[1] // 2
        return wheels

    @property
    def work(self) -> int:
        """How many flights of components were computed."""
        return int(self.flown.sum())

    @property
    def span(self) -> tuple[float, float]:
        """First and last local time at which `at` can be evaluated."""
        return float(self.tau[0]), float(self.tau[self.found]) if self.until is None else self.until


def gap_moments(covariance: Floats, order: int) -> Floats:
    """Raw moments of Gaussian perturbations in each gap.

    Shapes: `covariance` (count, 2 wheels, 2 wheels); result (count, wheels, order + 1, order + 1).
    """
    x = np.arange(0, covariance.shape[1], 2)
    y = x + 1
    raw = np.zeros((order + 1, order + 1, len(covariance), x.size))
    fill_gaussian_moments(covariance[:, x, x], covariance[:, x, y], covariance[:, y, y], raw)
    return np.ascontiguousarray(raw.transpose(2, 3, 0, 1))


CHANGED = 1.0  # error per change from the coarser level
ERROR_PER_SLOW_SHARE = 1.0  # error per share of slow impacts
# errors of mean and sd, per ratio of second-order to first-order sd
CURVED = np.array([0.05, 0.15])
ERROR_PER_SPLIT = 0.2  # error per unit of what further splits are worth
# of a component's flight on one core, with splitting and merging; measured once for two wheels
COMPONENT_MICROSECONDS = 60.0
# what more wheels than two cost, as a power of their number; measured once for 3 to 16
COST_POWER = 1.5
FLIGHT_MICROSECONDS = 0.8  # of a path's flight, as the cost model of exact flights has it
COVERAGE = "estimates; at most one row in ten is beyond them"  # measured: docs/theory/closures.md
LEAST_BELIEVED_ERROR = 1e-3  # error below which no bound is believed: 12 impacts of a million paths
# standard errors that with 95 % probability no mean or sd of 12 impacts is off by more than
ALL = 3.5
LEAST_WALL_VARIANCE = 1e-18  # variance of a displacement at its wall: rounding
SDS = 2.0  # tolerance of the sds over that of the means, as in a verdict


def bounds(coarse: Trace, fine: Trace) -> Floats:
    """Bounds of the errors of the finer of two traces.

    Returns: Of mean and sd of the section quantities, in sds; infinite where only the finer one
    goes on, NaN at the start, at the displacement of the mesh that most paths strike, and where a
    quantity does not vary. Shapes: result (impacts + 1, 2, quantities).
    """
    change = unknown(len(fine.tau), 2, fine.sd.shape[1])
    with np.errstate(invalid="ignore", divide="ignore"):
        change[:, 0] = np.abs(_means(fine) - _means(coarse)) / fine.sd
        change[:, 1] = np.abs(coarse.sd / fine.sd - 1.0)
    change[coarse.found + 1 : fine.found + 1] = np.inf
    missing = ~(fine.sd > 0.0)
    (struck,) = fine.mesh.nonzero()
    missing[struck, 2 * fine.mesh[struck]] = True
    missing = np.repeat(missing[:, None], 2, axis=1)
    change[missing] = np.nan
    change = np.fmax.accumulate(change)
    common = np.hypot(
        ERROR_PER_SLOW_SHARE * _so_far(fine.slow),
        ERROR_PER_SPLIT * np.minimum(_so_far(fine.residual), 1.0),
    )
    # the mean of the paths that are left is at most so many sds off that of all
    common = np.hypot(common, np.sqrt(_so_far(fine.discarded)))
    error = np.asarray(np.hypot(CHANGED * change, common[:, None, None]))
    error[:, 1] *= 1.0 + np.log(np.fmax(kurtosis(fine) / 3.0, 1.0))
    if fine.carried is not None:
        error = np.hypot(error, ERROR_PER_SLOW_SHARE * fine.carried[:, None])
    if fine.doubted is not None:
        error = np.hypot(error, fine.doubted)
    error = np.asarray(
        np.hypot(error, CURVED[:, None] * np.sqrt(_so_far(fine.bent))[:, None, None])
    )
    error[missing] = np.nan
    worst = np.fmax.accumulate(np.fmax.reduce(error, axis=2))
    error[1:] = np.fmax(error[1:], worst[:-1, :, None])
    error[missing] = np.nan
    return error


def _so_far(sign: Floats | None) -> Floats:
    """The largest value up to each impact."""
    return np.zeros(1) if sign is None else np.asarray(np.fmax.accumulate(sign))


def _means(found: Trace) -> Floats:
    """Means of the section quantities, shape (impacts + 1, quantities)."""
    flight = np.concatenate([[np.nan], np.diff(found.tau)])
    return np.column_stack([found.tau, flight, found.mean])


def within(error: Floats, tolerance: float) -> Bools:
    """Whether the bounds of an impact's errors are within a tolerance.

    Shapes: `error` (impacts + 1, 2, quantities); result (impacts + 1,).
    """
    limits = np.array([tolerance, SDS * tolerance])[:, None]
    return np.asarray(~(error > limits).any(axis=(1, 2)))


def largest_error(errors: Floats) -> float:
    """The largest of some errors, leaving out those that are NaN."""
    return float(np.fmax.reduce(errors, axis=None))


def advice(found: Trace, tolerance: float) -> str:
    """Whether to use the closure or to simulate.

    With 95 % probability none of the errors of a simulation is above `ALL` standard errors.  It is
    advised where the closure's bounds are above the tolerance, and where as many paths as reach the
    bounds so are less counted work than the closure's components.
    """
    if found.error is None:
        return ""
    if found.found == 0:
        return "no impact could be followed: simulate"
    error = found.error[1 : found.found + 1]
    means = largest_error(error[:, 0])
    sds = largest_error(error[:, 1])
    said = f"own bounds of the errors ({COVERAGE}): means {means:.2g}, sds {sds:.2g} of an sd"
    wrong = np.flatnonzero(np.logical_not(within(error, tolerance)))
    if wrong.size > 0 and wrong[0] == 0:
        return f"{said}, above the tolerance {tolerance:g} from impact 1 on: simulate"
    if wrong.size > 0:
        return (
            f"{said}, within the tolerance {tolerance:g} up to impact {wrong[0]}; beyond it"
            " simulate"
        )
    # all means and sds are within an error by so many paths, with 95 % probability: the standard
    # error of a mean is ``1 / sqrt(n)`` sds, that of an sd ``sqrt((kurtosis - 1) / 4 n)``
    heaviest = float(np.fmax.reduce(kurtosis(found), axis=None, initial=3.0))
    paths = (ALL / float(max(np.fmax(means, sds), LEAST_BELIEVED_ERROR))) ** 2 * max(
        1.0, 0.25 * (heaviest - 1.0)
    )
    work = 1e-6 * COMPONENT_MICROSECONDS * cost_factor(found.wheels) * found.work
    flights = max(1.0, 0.5 * found.wheels) * paths * found.found
    simulated = 1e-6 * FLIGHT_MICROSECONDS * flights
    if work > simulated:
        said += (
            f", within the tolerance {tolerance:g}; {paths:.1g} paths are as accurate at less work"
        )
        return f"{said} ({simulated:.1g} s against {work:.1g} s of a core): simulate"
    return f"{said}; by them within the tolerance {tolerance:g}"


def kurtosis(found: Trace) -> Floats:
    """Kurtosis of the section quantities, shape (impacts + 1, quantities); NaN where they do not
    vary or nothing is known."""
    out = unknown(*found.sd.shape)
    for k, (weights, means, variances) in (found.parts or {}).items():
        off = means - weights @ means
        second = weights @ (off**2 + variances)
        fourth = weights @ (off**4 + (6.0 * off**2 + 3.0 * variances) * variances)
        varies = second > LEAST_WALL_VARIANCE
        out[k, varies] = fourth[varies] / second[varies] ** 2
    return out


def check_row(name: str, scene: Scene) -> None:
    """Refuse a scene other than the paper's, for a closure that is the paper's: one or two wheels
    in a row."""
    if not scene.is_gears or any(wheel.restitution for wheel in scene.tree):
        why = "is the paper's closure, for gears of a constant restitution with a noisy drive"
        raise InputError("scene", scene.wheel_names, f"{name} {why}")
    meshes = [(wheel.parent, wheel.ratio) for wheel in scene.tree]
    if meshes not in ([(0, 1.0)], [(0, 1.0), (1, 1.0)]):
        why = "is the paper's closure, for one or two wheels in a row; use saltation or branching"
        raise InputError("wheels", len(meshes), f"{name} {why}")


def cost_factor(wheels: int) -> float:
    """How many times the cost for one or two wheels an impact or a component costs."""
    return float(max(1.0, (0.5 * wheels) ** COST_POWER))


def check_white(scene: Scene) -> None:
    """Refuse a scene whose noise has a memory, for a closure that knows white noise alone."""
    if scene.correlation_time:
        raise InputError(
            "correlation_time", scene.correlation_time, "this closure is for white noise only, 0"
        )
