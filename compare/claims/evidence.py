"""Everything that the claims are judged by, measured once."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rattle.compare.chaos.exponents import Exponents, Mean, drift_exponents, lyapunov, ratio_mean
from rattle.compare.chaos.measure import ChaosStudy, study
from rattle.compare.chaos.record import Regime, noisy_record, orbit_record
from rattle.compare.chaos.sweep import paper_noise
from rattle.compare.validation.validate import Validation, validate
from rattle.montecarlo import Ensemble, Record, simulate
from rattle.scene.scene import Scene, Start
from rattle.scene.tangent import Stretch

__all__ = ["Evidence", "gather"]

FLIGHTS = np.array([0.5, 1.5, 3.0])  # instants of a flight without walls
STEP = 2e-3
REPEATS, STEPS = 100_000, 2_000_000  # impacts of the orbit and steps of a noisy path in which repeats are counted


@dataclass(frozen=True)
class Evidence:
    """What was measured.

    Attributes
    ----------
    scene : Scene
        At the paper's noise.
    validations : list of Validation
        At rising noise intensities, the last the paper's.
    chaos : ChaosStudy
        With its sweep over alpha.
    single : dict of str to Exponents
        Of the single-stage system: ``orbit`` and ``noisy``.
    flight : Ensemble
        Paths that no wall stops.
    open_space : Scene
        Their scene.
    repeats : dict of str to Mean
        Share of consecutive impacts at one mesh that are on the same side: ``orbit`` and ``noisy``.
    """

    scene: Scene
    validations: list[Validation]
    chaos: ChaosStudy
    single: dict[str, Exponents]
    flight: Ensemble
    open_space: Scene
    repeats: dict[str, Mean]


def gather(
    scene: Scene, *, sigmas: Sequence[float], at: Sequence[float], paths: int = 100_000, impacts: int = 12,
    seed: int = 0, workers: int = 2, points: int = 1_000_000, spectrum_impacts: int = 200_000, events: int = 4000,
) -> Evidence:  # fmt: skip
    """Measure what the claims need.

    Parameters
    ----------
    scene : Scene
        Two stages; its noise is set to the paper's, ``sqrt(alpha)``.
    sigmas : sequence of float
        Noise intensities of the validations beside the paper's.
    at : sequence of float
        Values of alpha in the sweep.
    paths, impacts, seed, workers
        Of the validations.
    points, spectrum_impacts, events
        Of the sections, of the spectra and of the pairs of paths, see `rattle.compare.chaos.measure.study`.
    """
    scene = paper_noise(scene)
    levels = [*sorted(sigmas), scene.sigma]
    settings: dict[str, Any] = {"impacts": impacts, "paths": paths, "rng": seed, "workers": workers}
    validations = [validate(scene.with_sigma(s), scheme="exact-flight", **settings) for s in levels]
    exponents: dict[str, Any] = {"width": 0.02, "strict": False}
    single = replace(scene, stages=1, start=Start(0.0, scene.gap1, 2.0, 0.0, 0.0, mesh=1))
    open_space = replace(scene, gap1=1e6, gap2=1e6, tolerance=None, start=Start(0.3, 0.1, -0.4, -0.2, 0.5))
    flight = simulate(
        open_space,
        paths=paths,
        impacts=1,
        dt=STEP,
        scheme="euler-maruyama",
        rng=seed,
        workers=workers,
        horizon=float(FLIGHTS[-1]) + 1.0,
        record=Record(step_bias=True, times=open_space.start.tau + FLIGHTS),
    )
    chaos = study(
        scene, at=at, noise=paper_noise, points=points, impacts=spectrum_impacts, events=events, seed=seed,
        workers=workers,
    )  # fmt: skip
    return Evidence(
        scene, validations, chaos,
        {"orbit": lyapunov(single, **exponents), "noisy": drift_exponents(single, **exponents, seed=seed)},
        flight, open_space,
        {
            "orbit": _repeats(orbit_record(scene, REPEATS, Regime(), tangent=False), scene.stages),
            "noisy": _repeats((s for s, _ in noisy_record(scene, STEPS, seed, Regime(), tangent=False)), scene.stages),
        },
    )  # fmt: skip


def _repeats(stretches: Iterable[Stretch], stages: int) -> Mean:
    """Share of consecutive impacts at one mesh that are on the same side."""
    code = np.concatenate([s.code for s in stretches])
    same = []
    for mesh in range(1, stages + 1):
        own = np.sign(code[np.abs(code) == mesh])
        same.append((own[1:] == own[:-1]).astype(float))
    counted = np.concatenate(same)
    return ratio_mean(counted, np.ones(counted.size))
