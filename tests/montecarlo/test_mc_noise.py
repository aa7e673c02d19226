"""Random streams: repeatable, apart from each other, tied to blocks and never to threads."""

import numpy as np
import pytest
from mc_checks import dat21

from montecarlo import block as block_module
from montecarlo import simulate
from montecarlo.block import BLOCK
from montecarlo.noise import streams

SEED = np.random.SeedSequence(7)


def firsts(seed, block):
    """Beginnings of the five streams of a block."""
    s = streams(seed, block)
    return [g.standard_normal(50) for g in (s.steps, *s.bridges, s.tolerance)]


def test_same_seed_and_block_give_the_same_streams():
    assert np.array_equal(firsts(np.random.SeedSequence(7), 3), firsts(np.random.SeedSequence(7), 3))


def test_purposes_blocks_seeds_and_spawned_seeds_have_streams_of_their_own():
    children = np.random.SeedSequence(7).spawn(2)
    every = [
        *firsts(SEED, 0), *firsts(SEED, 1), *firsts(SEED, 2), *firsts(np.random.SeedSequence(8), 0),
        *firsts(children[0], 0), *firsts(children[1], 0), *firsts(children[0].spawn(1)[0], 0),
    ]  # fmt: skip
    assert len({x.tobytes() for x in every}) == len(every)
    correlation = np.corrcoef(every)[np.triu_indices(len(every), 1)]
    assert np.abs(correlation).max() < 0.75  # 595 pairs of 50 numbers: sd 0.14, five sigma


def shared_times(run):
    """First-impact times that occur more than once; located times are continuous, so none should."""
    first = run.raw[:, 0, 0]
    return first.size - np.unique(first).size


def correlation_of_blocks(run):
    """Largest z-score of the correlation of first-impact times between two full blocks."""
    first = run.raw[: run.paths // BLOCK * BLOCK, 0, 0].reshape(-1, BLOCK)
    c = np.corrcoef(first)[np.triu_indices(len(first), 1)]
    return np.abs(c).max() * np.sqrt(BLOCK)


def three_blocks():
    return simulate(dat21(0.2), paths=3 * BLOCK, impacts=1, dt=5e-3, rng=1, keep_paths=True)


def test_no_block_repeats_another():
    run = three_blocks()
    assert shared_times(run) == 0
    assert correlation_of_blocks(run) < 3.6  # 1e-3 over three pairs


def test_a_stream_used_twice_is_seen(monkeypatch):
    monkeypatch.setattr(block_module, "streams", lambda seed, block: streams(seed, min(block, 1)))
    run = three_blocks()
    assert shared_times(run) >= BLOCK
    assert correlation_of_blocks(run) > 3.6


@pytest.fixture(scope="module")
def alone():
    return run_with(1)


def run_with(workers, **changes):
    return simulate(
        dat21(0.3), paths=5 * BLOCK + 17, impacts=4, dt=1e-2, rng=3, workers=workers, keep_paths=True,
        clock=[0.5, 1.0], histogram=True, **changes,
    )  # fmt: skip


@pytest.mark.parametrize("workers", [2, 3, 16])
def test_result_is_the_same_bit_for_bit_for_any_number_of_workers(alone, workers):
    run = run_with(workers)
    assert np.array_equal(alone.raw, run.raw)
    assert alone.section.equals(run.section)
    assert alone.clock().equals(run.clock())
    assert np.array_equal(alone.covariance, run.covariance)
    assert np.array_equal(alone.histograms.counts, run.histograms.counts)


def test_more_paths_leave_the_earlier_full_blocks_as_they_were(alone):
    fewer = simulate(
        dat21(0.3), paths=2 * BLOCK, impacts=4, dt=1e-2, rng=3, keep_paths=True, clock=[0.5, 1.0]
    )  # fmt: skip
    assert np.array_equal(alone.raw[: 2 * BLOCK], fewer.raw)


def test_a_seed_and_its_sequence_are_the_same_and_another_seed_is_not():
    raws = [
        simulate(dat21(0.3), paths=5, impacts=2, dt=1e-2, rng=rng, keep_paths=True).raw
        for rng in (3, np.random.SeedSequence(3), 4, np.random.SeedSequence(3).spawn(1)[0])
    ]
    assert np.array_equal(raws[0], raws[1])
    assert not np.isin(raws[0][:, 0, 0], raws[2][:, 0, 0]).any()
    assert not np.isin(raws[0][:, 0, 0], raws[3][:, 0, 0]).any()


def test_a_spawned_seed_does_not_depend_on_what_else_it_was_used_for():
    seed = np.random.SeedSequence(3)
    first = simulate(dat21(0.3), paths=5, impacts=1, dt=1e-2, rng=seed).section
    assert seed.n_children_spawned == 0
    assert first.equals(simulate(dat21(0.3), paths=5, impacts=1, dt=1e-2, rng=seed).section)


def test_step_bias_leaves_a_lone_path_of_the_fine_run_as_it_was():
    """With more paths in a block, lanes are freed later, so the same stream is dealt out differently; see below."""
    raws = [
        simulate(dat21(0.3), paths=1, impacts=6, dt=5e-3, rng=9, keep_paths=True, step_bias=b).raw
        for b in (False, True)
    ]
    assert np.array_equal(raws[0], raws[1])


def test_step_bias_leaves_a_block_as_it_was_until_its_first_path_is_done():
    raws = [
        simulate(dat21(0.3), paths=100, impacts=12, dt=5e-3, rng=9, keep_paths=True, step_bias=b).raw
        for b in (False, True)
    ]
    same = (raws[0] == raws[1]).all(axis=(0, 2))
    assert same[:4].all()
