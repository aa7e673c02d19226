"""Batches of paths and the energy of impacts: what is summed in blocks is what the paths say."""

import numpy as np
from mc_checks import dat21, limit

from rattle.montecarlo import Record, simulate
from rattle.montecarlo.ensemble.simulate import extend
from rattle.montecarlo.kernel.block import BLOCK
from rattle.montecarlo.kernel.blocks import in_threads
from rattle.montecarlo.settings import Sampling
from rattle.montecarlo.statistics.records import BATCHES


def test_batches_are_the_paths_of_their_blocks():
    run = simulate(dat21(0.2), paths=34 * BLOCK + 5, impacts=3, rng=1, record=Record(raw=True, batches=True))
    for b in (0, 1, 2, 31):
        own = np.concatenate([run.raw[i * BLOCK : (i + 1) * BLOCK, :, :6] for i in range(b, 35, BATCHES)])
        assert (run.batches.n[b] == len(own)).all()
        np.testing.assert_allclose(run.batches.mean[b], own.mean(axis=0), rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(run.batches.sd[b], own.std(axis=0), rtol=1e-9, atol=1e-12)


def test_batches_of_an_extended_run_are_those_of_the_whole():
    settings = {"impacts": 2, "rng": 4, "sampling": Sampling(control=True), "record": Record(batches=True)}
    whole = simulate(dat21(0.05), paths=6 * BLOCK, **settings).batches
    part = simulate(dat21(0.05), paths=4 * BLOCK, **settings)
    more = extend(part, 6 * BLOCK, in_threads(2)).batches
    for name in ("n", "mean", "squares", "control"):
        assert (getattr(whole, name) == getattr(more, name)).all()
    assert part.batches.n.sum() < more.n.sum()  # the shorter run is not touched


def test_energy_is_what_each_impact_takes():
    scene = dat21(0.5)
    run = simulate(scene, paths=3000, impacts=4, rng=2, record=Record(raw=True, energy=True))
    mesh = np.abs(run.raw[:, :, 6])
    share = 0.5 * (1.0 - scene.epsilon**2)
    lost = share * np.where(mesh == 1, run.raw[:, :, 3] ** 2, scene.mu * run.raw[:, :, 5] ** 2)
    np.testing.assert_allclose(run.section["energy"], lost.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(run.section["se_energy"], lost.std(axis=0) / np.sqrt(3000), rtol=1e-9)
    assert "energy" not in simulate(scene, paths=10, impacts=1).section


def test_paired_differences_have_the_errors_that_they_state():
    """Twenty pairs of short runs on common noise: the spread of their differences is the paired standard error."""
    from rattle.compare.study.cells import Sample
    from rattle.compare.study.impacts import compare_paired

    found = []
    for seed in range(20):
        runs = [Sample(dat21(s), impacts=2, seed=seed, paths=32 * BLOCK // 8) for s in (0.3, 0.33)]
        found.append(compare_paired(*(cell.restore(cell.compute()) for cell in runs)))
    rows = [t[(t["impact"] == 2) & (t["quantity"] == "tau")].set_index("moment") for t in found]
    for moment in ("mean", "sd"):
        spread = np.std([r["difference"][moment] for r in rows], ddof=1)
        stated = np.sqrt(np.mean([r["se"][moment] ** 2 for r in rows]))
        alone = np.sqrt(np.mean([r["se_independent"][moment] ** 2 for r in rows]))
        half = limit(2) / np.sqrt(2.0 * 19)  # relative error of an sd of twenty
        assert abs(spread / stated - 1.0) < half + 0.1
        assert stated < 0.8 * alone  # common noise is worth something, and the check sees what it is worth
        assert abs(spread / (0.3 * stated) - 1.0) > half + 0.1  # negative control: a wrong standard error
