"""What a simulation is asked for; settings in, a plan of the work out, or a clear refusal before
any work starts."""

import math
from collections.abc import Iterable, Mapping, Sequence, Sized
from dataclasses import dataclass, field

import numpy as np

from rattle.montecarlo.kernel.block import BLOCK, Plan, sample
from rattle.montecarlo.kernel.blocks import Blocks
from rattle.montecarlo.kernel.kernel import columns_recorded
from rattle.montecarlo.noise.philox import LEVELS
from rattle.montecarlo.schemes.control_variate import linear_path, no_control
from rattle.montecarlo.schemes.exact_flight import accurate_flight
from rattle.montecarlo.schemes.step_size import (
    COARSEST,
    SCHEMES,
    check_step,
    default_step,
)
from rattle.montecarlo.schemes.step_state import MOST_IN_A_STEP
from rattle.montecarlo.seed import Seed, read_seed
from rattle.scene import (
    Floats,
    InputError,
    Ints,
    Scene,
    check_each_impact,
    check_scene,
    choice,
    count,
    finite,
    positive,
)
from rattle.scene.orbit import follow

NOISE_FREE = "noise-free"
"""Name of the itinerary of the noise-free path, by exact flights."""

EXACT_SCHEME = "exact-flight"

MOST_PATHS = 2**40
MOST_WORKERS = 1024
# of the impacts of a path, all of which a block of paths keeps: 0.6 GB of it
MOST_NUMBERS_OF_A_PATH = 70_000

HORIZON_PER_IMPACT = 50.0
"""Default time after which a path is given up, per impact asked for; flights of DAT21 last about
0.5."""

LONG_FLIGHTS = 10.0
"""The same in flights as long as the longest without noise, for bodies that are no gears."""

DEFAULT_STEPS = 10**7
MOST_STEPS_OF_A_PATH = 10**9
"""Steps after which a path is given up: by default (half a minute for a block of slow paths), and
at the most."""


@dataclass(frozen=True)
class Record:
    """What a simulation records beside the section moments; nothing else is computed or kept.

    Parameters
    ----------
    times : sequence of float
        Times at which the moments of all paths are taken, see `Ensemble.at_times`; on the grid of
        the coarsest step.
    step_bias : bool, optional
        Run 2 dt and 4 dt on the same Brownian paths beside dt, and estimate the bias of the step
        from the differences (Richardson extrapolation; about two thirds more work).  By default
        where the scheme has such a bias, and 4 dt is admissible.
    itineraries : mapping of str to sequence of int
        Named itineraries ``mesh * side``, one entry for each impact, whose agreement with the paths
        is counted beside that of the noise-free path.
    on_itinerary : bool
        The moments of the paths that have followed an itinerary so far, `Ensemble.on_itinerary`,
        and how the others leave it, `Ensemble.leaving`.
    histogram : bool
        Histograms of each section quantity at each impact, `Ensemble.histograms`.
    raw : bool
        Every impact of every path, `Ensemble.records` and `Ensemble.raw`; memory then grows with
        the paths (56 bytes an impact).
    energy : bool
        The mean energy lost at each impact.
    batches : bool
        Means and sds of batches of paths, `Ensemble.batches`, for intervals of what is computed
        from them.

    Examples
    --------
    >>> from rattle.montecarlo import simulate
    >>> from rattle.scene import DAT21, Scene
    >>> scene = Scene.from_gears(DAT21, sigma=0.1)
    >>> run = simulate(scene, paths=64, impacts=3, record=Record(energy=True, raw=True))
    >>> run.raw.shape, "energy" in run.section
    ((64, 3, 7), True)
    """

    times: Sequence[float] | Floats = ()
    step_bias: bool | None = None
    itineraries: Mapping[str, Sequence[int]] = field(default_factory=dict)
    on_itinerary: bool = False
    histogram: bool = False
    raw: bool = False
    energy: bool = False
    batches: bool = False


@dataclass(frozen=True)
class Sampling:
    """How `simulate` samples its paths: what few runs need, with defaults for all others.

    Parameters
    ----------
    control : bool
        Use the linearised path as a control variate for section means and sds (``exact-flight``
        only).
    increments : {"gaussian", "two-point"}
        Distribution of the Brownian increments of an Euler-Maruyama step; two-point ones (plus or
        minus the root of the step) have the same weak order 1 and cost one random bit.
    horizon : float, optional
        Time after the start at which unfinished paths are given up; by default 50 per impact
        (for bodies that are no gears at least 10 of the longest flight without noise), or 10
        million steps.
    blocks : callable, optional
        Who runs the blocks of paths; by default threads of this process.  The result does not
        depend on it.

    Examples
    --------
    >>> from rattle import DAT21, Sampling, Scene, simulate
    >>> scene = Scene.from_gears(DAT21, sigma=0.05)
    >>> run = simulate(scene, paths=1000, impacts=2, rng=7, sampling=Sampling(control=True))
    >>> plain = simulate(scene, paths=1000, impacts=2, rng=7)
    >>> bool((run.section["se_tau"] < plain.section["se_tau"]).all())
    True
    """

    control: bool = False
    increments: str = "gaussian"
    horizon: float | None = None
    blocks: Blocks | None = None


def is_random(scene: Scene) -> bool:
    """Whether one path differs from another: noise, or a random tolerance or restitution."""
    tolerance = scene.tolerance
    gaps_vary = tolerance is not None and tolerance.distribution != "fixed"
    return scene.sigma > 0.0 or gaps_vary or any(wheel.law.sd for wheel in scene.tree)


def count_followed(scene: Scene, paths: int) -> int:
    """How many of these paths are followed: one stands for all where nothing is random."""
    return paths if is_random(scene) else 1


def default_horizon(scene: Scene, impacts: int, dt: float) -> float:
    """Time after which a path is given up where none is given."""
    per_impact = HORIZON_PER_IMPACT
    if not scene.is_gears:
        flights = follow(scene, impacts).flight
        per_impact = float(np.nanmax([per_impact, *(LONG_FLIGHTS * flights)]))
    return min(per_impact * impacts, DEFAULT_STEPS * dt)


def most_impacts(scene: Scene) -> int:
    """Most impacts of a path in a run: 10 000 of two wheels, and fewer the more there are."""
    return MOST_NUMBERS_OF_A_PATH // columns_recorded(scene.stages)


def check_settings(
    scene: Scene,
    paths: int,
    impacts: int,
    dt: float | None,
    scheme: str,
    rng: Seed,
    workers: int,
    step_bias: bool = False,
) -> None:
    """Refuse settings that `simulate` could not run, before any work."""
    check_scene(scene)
    count("paths", paths, most=MOST_PATHS)
    count("impacts", impacts, most=most_impacts(scene))
    count("workers", workers, most=MOST_WORKERS)
    choice("scheme", scheme, SCHEMES)
    read_seed(rng)
    if dt is not None:
        check_step(scene, dt, scheme, COARSEST if step_bias else 1)


def plan_of(
    scene: Scene,
    paths: int,
    impacts: int,
    dt: float,
    scheme: str,
    rng: Seed = 0,
    workers: int = 1,
    record: Record | None = None,
    sampling: Sampling | None = None,
    any_step: bool = False,
) -> Plan:
    """Turn settings into the plan of a run.

    `any_step`: Take a step that is not admissible too, to measure what becomes of it.
    """
    record = record or Record()
    sampling = sampling or Sampling()
    step = min(dt, default_step(scene, scheme)) if any_step else dt
    check_settings(scene, paths, impacts, step, scheme, rng, workers, bool(record.step_bias))
    if sampling.control and SCHEMES[scheme].normals < 2:
        raise InputError(
            "sampling.control", True, f"works with scheme 'exact-flight' only; scheme = {scheme!r}"
        )
    if scene.correlation_time and sampling.control:
        raise InputError(
            "sampling.control", True, "is for white noise only; correlation_time is not 0"
        )
    if record.energy:
        check_each_impact(scene)
    two_point = (
        choice("sampling.increments", sampling.increments, ("gaussian", "two-point")) == "two-point"
    )
    if two_point and SCHEMES[scheme].normals > 1:
        why = f"works with the Euler-Maruyama schemes only; scheme = {scheme!r}"
        raise InputError("sampling.increments", sampling.increments, why)
    levels, coarsest = (LEVELS, COARSEST) if record.step_bias else (1, 1)
    dt = float(dt)
    horizon = _horizon(sampling.horizon, scene, impacts, dt * coarsest, scheme)
    if not isinstance(record.itineraries, Mapping):
        why = "give a mapping from names to sequences of mesh * side"
        raise InputError("record.itineraries", record.itineraries, why)
    named = {
        name: _check_itinerary(name, itinerary, impacts, scene.stages)
        for name, itinerary in record.itineraries.items()
    }
    plan = Plan(
        scene=scene,
        paths=count_followed(scene, paths),
        impacts=impacts,
        dt=dt,
        scheme=scheme,
        seed=rng if isinstance(rng, np.random.SeedSequence) else np.random.SeedSequence(rng),
        most_steps=math.ceil(horizon / (dt * coarsest)) * coarsest,
        fixed_steps=_fixed_steps(scene, record.times, dt * coarsest, horizon) * coarsest,
        itineraries=named,
        levels=levels,
        keep=record.histogram or record.raw,
        control=(
            linear_path(scene, impacts, dt)
            if sampling.control and scene.sigma > 0.0
            else no_control()
        ),
        two_point=two_point,
        energy=record.energy,
    )
    named[NOISE_FREE] = tuple(exact_orbit(plan)[:, -1].astype(int).tolist())
    return plan._replace(apart=_longest(named)) if record.on_itinerary else plan


def _longest(itineraries: dict[str, tuple[int, ...]]) -> tuple[str, ...]:
    """Names of the itineraries of which no other is the beginning or the same."""
    reasons: list[str] = []
    for name in sorted(
        itineraries, key=lambda n: (-np.count_nonzero(itineraries[n]), n != NOISE_FREE)
    ):
        if not any(begins(itineraries[name], itineraries[other]) for other in reasons):
            reasons.append(name)
    return tuple(reasons)


def begins(itinerary: Sequence[int], other: Sequence[int]) -> bool:
    """Whether an itinerary, which may end early (0), is the beginning of another, or the same."""
    return all(a in (0, b) for a, b in zip(itinerary, other, strict=True))


def exact_orbit(plan: Plan) -> Floats:
    """The noise-free path by exact flights, whatever the scheme of the plan.

    Rows ``tau, flight, x1, y1, ..., mesh * side`` of each impact, shape (impacts, 3 + 2 wheels); 0
    after the last one.
    """
    step = min(SCHEMES[EXACT_SCHEME].step, accurate_flight(plan.scene)[0])
    return noise_free_path(
        plan, EXACT_SCHEME, min(plan.dt, step) if plan.impacts > MOST_IN_A_STEP else step
    )


def noise_free_path(plan: Plan, scheme: str, dt: float) -> Floats:
    """The path of a plan without noise, by a scheme and a step; rows as of `exact_orbit`."""
    scene = plan.scene.noise_free
    most_steps = math.ceil(plan.most_steps * plan.dt / dt)
    start = Plan(
        scene, 1, plan.impacts, dt, scheme, plan.seed, most_steps, np.empty(0, np.int64), {}, 1
    )
    return np.asarray(np.nan_to_num(sample(start, 0).rows[0, 0]))


def _horizon(given: float | None, scene: Scene, impacts: int, dt: float, scheme: str) -> float:
    """Time after which a path is given up: as given, if it can be waited for, or the default."""
    if given is None:
        return default_horizon(scene, impacts, dt)
    if positive("sampling.horizon", given) / dt > MOST_STEPS_OF_A_PATH:
        hours = given / dt * BLOCK * SCHEMES[scheme].step_ns * 1e-9 / 3600.0
        longest = MOST_STEPS_OF_A_PATH * dt
        why = f"must be at most {longest:.3g}, {MOST_STEPS_OF_A_PATH:.0e} steps of {dt:.3g}"
        raise InputError(
            "sampling.horizon", given, f"{why}; {BLOCK} paths that last would take {hours:.3g} h"
        )
    return given


def _fixed_steps(scene: Scene, times: Sequence[float] | Floats, dt: float, horizon: float) -> Ints:
    if not isinstance(times, Iterable):
        raise InputError("record.times", times, "give a sequence of times")
    steps = []
    for t in times:
        since = finite("record.times", t) - scene.start.tau
        if not dt <= since <= horizon:
            raise InputError(
                "record.times", t, f"must lie between {dt:g} and {horizon:g} after the start"
            )
        steps.append(round(since / dt))
    return np.unique(np.array(steps, dtype=np.int64))


def _check_itinerary(
    name: str, itinerary: Sequence[int], impacts: int, wheels: int
) -> tuple[int, ...]:
    field = f"record.itineraries[{name!r}]"
    if name == NOISE_FREE:
        raise InputError("record.itineraries", name, "this name is taken by the noise-free path")
    if not isinstance(itinerary, Sized) or len(itinerary) != impacts:
        raise InputError(field, itinerary, f"needs one entry for each of {impacts} impacts")
    return tuple(count(field, code, least=-wheels, most=wheels) for code in itinerary)
