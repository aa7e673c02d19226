"""What to take at the noise intensities that were asked for, and what both sides cost in counted
work."""

import numpy as np
import pandas as pd
import pytest
from scenes import dat21

from rattle import mean_map, simulate_to, validate
from rattle.closure import CLOSURES
from rattle.closure.mean_map import closure_seconds
from rattle.compare.validation.answer import advice, answer, cost_sentence
from rattle.compare.validation.comparison import WANTED, paths_for, simulation_costs
from rattle.compare.validation.validate import sweep
from rattle.montecarlo.accuracy.cost import cost_of, cost_to

ADVISED = (0.01, 0.1, 1.0)
ALL = (12, 12)
OPEN = (3, 12)
NEVER = (0, 0)
ACCURATE = "(all means and sds at 12 impacts are accurate)"


def table(**closures):
    """Ranges of validity over `ADVISED`: for each closure pairs of accurate and not inaccurate."""
    parts = [
        pd.DataFrame(pairs, columns=["accurate", "not_inaccurate"]).assign(
            closure=name, sigma=ADVISED
        )
        for name, pairs in closures.items()
    ]
    return pd.concat(parts, ignore_index=True)


def work(ranges, gains=(100.0, 100.0, 100.0), resolved=True):
    """Work of the closures that are accurate at the first impact: `gains` of `branching` over
    `ADVISED`, 100 of others."""
    seconds = ranges["closure"].map({"saltation": 1e-3, "branching": 0.5, "corrected": 1e-4})
    gain = ranges["sigma"].map(dict(zip(ADVISED, gains, strict=True)))
    return ranges.query("accurate > 0").assign(
        impacts=ranges["accurate"],
        resolved=resolved,
        closure_seconds=seconds,
        speed_up=gain.where(ranges["closure"] == "branching", 100.0),
    )


ADVICE = {
    "one closure, then simulate": (
        {"corrected": [NEVER] * 3, "saltation": [ALL, (3, 3), NEVER]},
        {},
        f"take `saltation` at σ = 0.01 {ACCURATE}; simulate at σ = 0.1 "
        "(no closure is accurate at all 12 impacts, `saltation` at the first 3); "
        "simulate at σ = 1 (no closure is accurate at all 12 impacts).",
    ),
    "what is undecided is not denied": (
        {"saltation": [ALL, NEVER, NEVER], "branching": [ALL, OPEN, OPEN]},
        {},
        f"take `saltation` at σ = 0.01 {ACCURATE}; simulate at σ = 0.1 "
        "(`branching` is undecided: more paths would settle it); "
        "simulate at σ = 1 (`branching` is undecided: more paths would settle it).",
    ),
    "the one of less work, and at more noise the one that is accurate there": (
        {"branching": [ALL, ALL, ALL], "saltation": [ALL, NEVER, NEVER]},
        {"gains": (20.0, 2.0, 0.4)},
        f"take `saltation` at σ = 0.01 {ACCURATE}; take `branching` at σ = 0.1 {ACCURATE}; "
        "simulate at σ = 1 (`branching` is accurate, but takes more work than "
        "an equally accurate simulation).",
    ),
}


@pytest.mark.parametrize("case", ADVICE)
def test_advice(case):
    closures, gains, said = ADVICE[case]
    ranges = table(**closures)
    assert advice(ranges, 12, work(ranges, **gains)) == f"For this gear pair {said}"


def test_work_does_not_decide_where_the_error_is_not_known():
    """The worst error may be smaller than it looks, and a simulation as accurate larger."""
    ranges = table(branching=[ALL] * 3)
    assert "simulate" not in advice(ranges, 12, work(ranges, (0.1, 0.1, 0.1), resolved=False))


def test_cost_is_a_sentence_of_its_own():
    simulation = pd.DataFrame(
        {
            "sigma": ADVISED,
            "paths": [5_120, 123_456, 9.9e13],
            "core_seconds": [0.05, 180.0, 1e9],
            "branches": [0, 4, 0],
            "scheme": "exact-flight",
        }
    )
    ranges = table(saltation=[ALL, NEVER, NEVER], branching=[ALL, ALL, NEVER])
    said = cost_sentence(
        simulation, work(ranges), 12, "24 ms of rattling", work(ranges, (20.0, 0.3, 0.1))
    )
    assert (
        said == "Nominal time on one core, from counted work: a simulation of 12 impacts (24 ms of"
        " rattling) to 1% of an sd takes 50 ms at σ = 0.01 (5,120 paths), 3 minutes at σ = 0.1"
        " (120,000 paths, a part of them near 4 rare branches) and 32 years at σ = 1 (9.9e+13"
        " paths); `saltation` 1 ms and `branching` 0.5 s; at σ = 0.1 an equally accurate"
        " simulation takes less than `branching`."
    )


def test_headline_page_and_table_agree_where_a_clock_is_noisy(monkeypatch):
    """The measured speed-up of `branching` was 1.31, 0.71, 0.89, 1.24 ..., and its range ended at
    the first below 1."""
    clock = iter(np.random.default_rng(1).uniform(0.0, 1e3, 10_000).cumsum())
    monkeypatch.setattr("time.perf_counter", lambda: next(clock))
    scene = dat21(0.02)
    settings = {"impacts": 2, "paths": 20_000, "rng": 3, "closures": ["saltation", "branching"]}
    swept = sweep(scene, (0.01, 0.02), workers=1, **settings)
    said = answer([validate(scene, **settings)], swept)
    assert said[0].startswith("For this gear pair take `saltation` at σ = 0.02 (all means and sds")
    again = sweep(scene, (0.01, 0.02), workers=1, **settings)
    pd.testing.assert_frame_equal(again.speed, swept.speed)  # bit for bit: counted
    pd.testing.assert_frame_equal(again.simulation, swept.simulation)


# that a forecast is off by at most: a pilot run knows the kurtosis, so the paths, to a fifth
FORECAST = 1.5


def test_the_page_knows_that_a_run_to_an_accuracy_samples_rare_branches():
    """Plain paths take 400 times as long here."""
    scene = dat21(0.1)
    pilot = validate(scene, impacts=3, closures=["saltation"], paths=16_384, rng=1)
    (cost,) = simulation_costs([pilot]).itertuples()
    run = simulate_to(scene, WANTED, impacts=3, rng=2)
    work = cost_of(run, run.paths).core_seconds
    assert cost.branches > 0
    assert 1.0 / FORECAST < cost.core_seconds / work < FORECAST
    # the negative control: plain paths
    assert cost_to(pilot.run, WANTED).core_seconds > 100.0 * work


def test_work_of_a_mixture_grows_with_its_components():
    few, many = (mean_map(dat21(s), impacts=2, closure="branching") for s in (1e-3, 0.5))
    assert many.trace.work > 10 * few.trace.work
    assert closure_seconds(many) <= CLOSURES["branching"].most_seconds(2, 2)
    assert (closure_seconds(many) - closure_seconds(few)) == pytest.approx(
        60e-6 * (many.trace.work - few.trace.work)
    )


def test_so_many_paths_bound_both_errors():
    """Of two means, whose standard errors for one path are the sds: (2.2414 / 0.1)^2."""
    assert paths_for(pd.DataFrame({"unit": [2.0, 3.0], "se": [2.0, 3.0]}), 0.1) == 503
