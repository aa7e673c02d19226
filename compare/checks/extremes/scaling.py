"""Exact invariances: shifts of time by whole periods, and a factor on all lengths, leave the results unchanged."""

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pandas as pd

from rattle import closure, montecarlo
from rattle.closure import CLOSURES, long_orbit
from rattle.compare.checks.extremes import truth
from rattle.compare.checks.extremes.extreme import extreme, farthest
from rattle.compare.validation import validate as validation
from rattle.montecarlo import SCHEMES, Record
from rattle.montecarlo.coupling import long_path
from rattle.scene import DAT21, Scene, Start, Tolerance

IMPACTS, PATHS = 3, 64
POWERS = (-26, -13, 14)  # powers of two as factors on the lengths of DAT21: half gaps of 7e-9, 6e-5 and 8e3
STARTS = (1e4, 1e8, 1e12, -1e12)
SIGMAS = (0.0, 1e-30, 1e-8, 1e4)
LENGTHS = ("x1", "y1", "x2", "y2")


def _scene(tau: float = 0.0) -> Scene:
    start = Start(tau, 0.5, 2.0, 0.5, 2.0, mesh=1)
    return Scene.from_gears(DAT21, sigma=0.1, start=start)


def _sections(scene: Scene) -> Iterator[tuple[str, pd.DataFrame]]:
    """Section tables of every closure and every scheme, with phase-reduced times."""
    for name in CLOSURES:
        yield name, closure.mean_map(scene, impacts=IMPACTS, closure=name).phase_reduced.section
    for scheme in SCHEMES:
        yield (
            scheme,
            montecarlo.simulate(
                scene, paths=PATHS, impacts=IMPACTS, scheme=scheme, rng=3, record=Record(step_bias=False)
            ).phase_reduced.section,
        )
    loose = Tolerance(scene.gap1 / 64.0, scene.gap2 / 64.0, draw="contact")
    noisy = replace(scene, tolerance=loose)
    yield "saltation, loose", closure.mean_map(noisy, impacts=IMPACTS, closure="saltation").phase_reduced.section
    yield (
        "exact-flight, loose",
        montecarlo.simulate(noisy, paths=PATHS, impacts=IMPACTS, scheme="exact-flight", rng=3).phase_reduced.section,
    )


def _stretches(scene: Scene) -> Iterator[np.ndarray]:
    """Phases, flights, growths and states before impacts of the long orbit and the long noisy path."""
    orbit = long_orbit.LongOrbit(scene).stretch(50)
    path, _ = long_path.LongPath(scene, seed=3).stretch(500)
    for s in (orbit, path):
        yield np.column_stack([s.phase, s.flight, s.growth, s.before])


def _verdicts(scene: Scene) -> np.ndarray:
    """The verdict on every moment of every closure."""
    found = validation.validate(scene, impacts=2, paths=1024, rng=1, scheme="exact-flight")
    return found.table["verdict"].to_numpy(str)


def _factors(table: pd.DataFrame, factor: float) -> np.ndarray:
    """Factors on the columns of a table when all lengths are multiplied by `factor`."""
    plain = [str(name).removeprefix("se_").removeprefix("sd_") in LENGTHS for name in table]
    return np.where(plain, factor, 1.0)


@extreme(
    "unit of length",
    "all lengths",
    "gaps 7e-9 to 8e3: every closure, scheme and verdict, chaos",
    "exact scaling, bit for bit",
    allowed=0.0,
    unit="each number",
)
def unit_of_length() -> Iterator[float]:
    """All lengths, speeds, accelerations and the noise times a power of two: every table scales bit for bit."""
    tables, stretches, verdicts = dict(_sections(_scene())), list(_stretches(_scene())), _verdicts(_scene())
    for power in POWERS:
        factor = 2.0**power
        scene = _scene().scaled(factor)
        for name, table in _sections(scene):
            numbers = tables[name].select_dtypes("number")
            exact = numbers.to_numpy(float) * _factors(numbers, factor)
            yield farthest(table.select_dtypes("number"), exact, np.maximum(np.abs(exact), 1e-300))
        yield float((_verdicts(scene) != verdicts).sum())
        for rows, exact in zip(_stretches(scene), stretches, strict=True):
            wide = exact * np.repeat([1.0, factor], [6, 4])
            yield farthest(rows, wide, np.maximum(np.abs(wide), 1e-300))


@extreme(
    "late start: flights, sds, means",
    "start.tau",
    "1e4 to 1e12, and -1e12: every closure, every scheme, chaos",
    "the same scene at the phase from 400 digits of pi",
    allowed=1e-11,
    unit="1, or each number",
)
def whole_periods() -> Iterator[float]:
    """A start so late that its absolute time lacks the digits of a flight, compared with the same phase near 0."""
    for tau in STARTS:
        late, reduced = _scene(tau), _scene(truth.phase(tau))
        for (_, a), (_, b) in zip(_sections(late), _sections(reduced), strict=True):
            exact = b.select_dtypes("number").to_numpy(float)
            yield farthest(a.select_dtypes("number"), exact, np.maximum(np.abs(exact), 1.0))
        for rows, exact in zip(_stretches(late), _stretches(reduced), strict=True):
            yield farthest(rows, exact, np.maximum(np.abs(exact), 1.0))


@extreme(
    "sds of linear closures",
    "sigma",
    "0, 1e-30 to 1e4: corrected, saltation",
    "proportional to sigma",
    allowed=1e-11,
    unit="each sd",
)
def proportional_sds() -> Iterator[float]:
    """Sds of the linear closures are proportional to the noise intensity."""
    for name in ("corrected", "saltation"):
        one, *others = (
            closure.mean_map(_scene().with_sigma(sigma), impacts=6, closure=name).section.filter(like="sd_")
            for sigma in (1.0, *SIGMAS)
        )
        for sigma, table in zip(SIGMAS, others, strict=True):
            exact = sigma * one.to_numpy()
            yield farthest(table, exact, np.maximum(exact, 1e-13 * sigma))


@extreme("phase of a late start", "start.tau", "10 to 1e12, both signs", "400 digits of pi")
def phases() -> Iterator[float]:
    """The phase of a late start."""
    starts = [s * 10.0**k for k in range(1, 12) for s in (1.0, -1.0, 3.7, 10.0)]
    found = [Scene.from_gears(DAT21, start=Start(t, 0.5, 2.0, 0.5, 2.0, mesh=1)).phase for t in starts]
    exact = np.array([truth.phase(t) for t in starts])
    yield farthest(found, exact, np.abs(exact))


@extreme(
    "late start: absolute times, and verdicts",
    "start.tau",
    "1e4 to 1e12, and -1e12",
    "sums of fractions; the verdicts at the same phase",
    allowed=0.5,
    unit="last place; verdicts",
)
def absolute_times() -> Iterator[float]:
    """Absolute times are the local ones plus that of the start, rounded once; verdicts do not depend on the start."""
    for tau in STARTS:
        late = _scene(tau)
        m = closure.mean_map(late, impacts=IMPACTS)
        since = m.phase_reduced.section["tau"].to_numpy() - late.phase
        exact = [float(Fraction(tau) + Fraction(s)) for s in since]
        yield farthest(m.section["tau"], exact, np.spacing(abs(tau)))
        scenes = (late, _scene(truth.phase(tau)))
        a, b = (validation.validate(s, impacts=2, paths=4096, rng=1, dt=0.01).table for s in scenes)
        yield float((a["verdict"] != b["verdict"]).sum())
        # at a fixed time `branching` takes back the noise of the rest of the flight, which cancels most of it
        scale = np.where((a["closure"] == "branching") & (a["kind"] == "fixed time"), 1e-7, 1e-11)[:, None]
        yield farthest(a[["error", "low", "high"]], b[["error", "low", "high"]], scale)


ROWS = (unit_of_length, proportional_sds, phases, whole_periods, absolute_times)
