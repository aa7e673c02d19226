"""What simulate() refuses, with which words, before any path has run."""

import math
from dataclasses import replace

import pytest
from mc_checks import stepped as simulate
from refusals import refusal
from scenes import dat21
from settings import EULER, EXACT, LOCATED, recorded

from rattle import Order, Sampling, Scene, Start, Tolerance, Wheel, simulate_to
from rattle.montecarlo import largest_step, simulate_rare

FAST_ORDER = dat21(0.1, drive=(Order(50),))
LONG_MEMORY, SHORT = (dat21(0.1, correlation_time=theta) for theta in (1.0, 0.01))
EIGHT = Scene(alpha=1.0, epsilon=0.5, wheels=[Wheel(beta=0.1, gamma=0.1)] * 8)
BAD_SETTINGS = {
    "no paths": ({"paths": 0}, "paths = 0: must be at least 1"),
    "no step": ({"dt": 0.0}, "dt = 0.0: must be greater than 0"),
    "a step in which nothing moves": (
        {"dt": 1e-306},
        "dt = 1e-306: must be at least 1.25e-08: 1e[+]07 shorter steps",
    ),
    "a step that misses the gap": ({"dt": 0.126}, r"dt = 0.126: must be at most 0.125: .* gap"),
    "a step too long once quadrupled": (
        {"dt": 0.05, "step_bias": True},
        r"at most 0.0312 \(4 dt .*\): .* gap",
    ),
    "an exact step that misses the modulation": (
        {"dt": 0.11, "scheme": "exact-flight"},
        "dt = 0.11: must be at most 0.1: .* modulation",
    ),
    "an unknown scheme": (
        {"scheme": "milstein"},
        "valid are 'euler-maruyama', 'euler-maruyama-located', 'exact-flight'",
    ),
    "a time beyond the horizon": (
        {"times": [1.0, 5.1], "horizon": 5.0},
        "record.times = 5.1: must lie .* and 5 after",
    ),
    "too long an itinerary": (
        {"itineraries": {"mine": [1, -1, 1, -1]}},
        "needs one entry for each of 3 impacts",
    ),
    "a control of Euler's steps": (
        {"control": True},
        "control = True: works with scheme 'exact-flight' only",
    ),
    "two-point increments of exact flights": (
        {"increments": "two-point", "scheme": "exact-flight", "dt": 0.05},
        "works with the Euler-Maruyama schemes only",
    ),
    "too many impacts of eight wheels": (
        {"scene": EIGHT, "impacts": 4000},
        "impacts = 4000: must be at most 3684",
    ),
    "a control with a memory": (
        {"scene": LONG_MEMORY, "control": True, "scheme": "exact-flight"},
        "for white noise only",
    ),
    "a step beyond the memory": (
        {"scene": SHORT, "dt": 0.01},
        "at most 0.001: a longer step cannot follow the memory",
    ),
    "a step beyond the orders": (
        {"scene": FAST_ORDER, "dt": 0.01, "scheme": "exact-flight"},
        "cannot follow the noise's modulation",
    ),
}


def simulated(**settings):
    return simulate(
        settings.pop("scene", dat21(0.1)), **recorded({"paths": 10, "impacts": 3} | settings)
    )


@pytest.mark.parametrize("case", BAD_SETTINGS)
def test_bad_input_is_refused_before_any_block_runs(case, monkeypatch):
    settings, words = BAD_SETTINGS[case]
    for name in ("kernel.blocks.run", "settings.sample"):
        monkeypatch.setattr(f"rattle.montecarlo.{name}", lambda *_: pytest.fail("work was done"))
    with refusal(words):
        simulated(**settings)


STEADY = Scene(alpha=0.0, epsilon=0.9, beta1=0.1, gamma1=0.0, stages=1, start=Start(0.0, 0.0, 1e-3))
DAMPED = replace(STEADY, beta1=20.0)
NARROW = replace(DAMPED, gap1=1e-9, start=Start(0.0, 0.0, 2.0))
TWO_WHEELS = dat21()
DRIVE_RATE = math.hypot(1.0, TWO_WHEELS.beta1)  # of the drive
STRONG_NOISE = 0.25 * (0.5 / (35.0 * DRIVE_RATE)) ** (2.0 / 3.0)
STEP_LIMITS = [
    (DAMPED, LOCATED, 0.05, "makes the damping unstable"),
    (STEADY, LOCATED, math.pi / 10.0, "cannot follow the excitation"),
    (DAMPED, EXACT, 0.01, "cannot follow the damping"),
    (NARROW, EXACT, 1e-9, "holds too many impacts"),
    (
        replace(TWO_WHEELS, gap1=0.1, start=Start(0.0, 0.1, 2.0, 0.5, 2.0, mesh=1)),
        EULER,
        0.025,
        "gap",
    ),
    (dat21(35.0), EULER, STRONG_NOISE, "noise"),
    # dragged across the half gap the path is as fast as sqrt(4 gamma g)
    (replace(TWO_WHEELS, gamma1=50.0), EULER, 0.25 / 10.0, "gap"),
    (replace(TWO_WHEELS, alpha=40.0), EULER, 0.25 / math.sqrt(80.0 * DRIVE_RATE), "gap"),
    (dat21(tolerance=Tolerance(0.1, 0.3)), EULER, 0.25 * 0.2, "gap"),
]


@pytest.mark.parametrize(("scene", "scheme", "limit", "why"), STEP_LIMITS)
def test_step_is_limited_by_damping_excitation_gap_and_impacts(scene, scheme, limit, why):
    found, said = largest_step(scene, scheme)
    assert found == pytest.approx(limit)
    assert why in said
    with refusal(why):
        simulated(scene=scene, scheme=scheme, dt=1.02 * limit)


def test_too_long_a_default_step_is_shortened_and_said_to_be():
    scene = dat21(1e4)
    run = simulated(scene=scene, horizon=0.05)
    assert run.dt == largest_step(scene, "euler-maruyama-located")[0] < 2e-3
    assert run.diagnostics[0].startswith("dt = 0.000339 in place of the scheme's 0.002: ")
    with refusal(r"dt = 0.002: must be at most 0.000339: .* noise throw"):
        simulated(scene=scene, dt=2e-3)


def test_run_that_could_not_end_is_refused_or_given_up_early():
    narrow = replace(STEADY, gap1=1e-8, start=Start(0.0, 1e-8, 1.0, mesh=1), beta1=0.0)
    said = r"horizon = 600.0: must be at most 5, 1e\+09 steps of 5e-09; .* h$"
    with refusal(said):
        simulated(scene=narrow, horizon=600.0, scheme="euler-maruyama", dt=5e-9)
    slow = replace(narrow, start=Start(0.0, 0.0, 1e-12))
    run = simulated(scene=slow, paths=1, dt=1e-6, scheme="euler-maruyama")
    assert (run.unfinished, run.path_steps) == (1, 10_000_000)


def test_rare_branches_are_of_white_noise():
    with refusal("with white noise only"):
        simulate_rare(LONG_MEMORY, paths=10, impacts=2)


def test_an_accuracy_chooses_how_paths_are_sampled():
    with refusal("give a Sampling with blocks alone"):
        simulate_to(dat21(0.1), 0.1, sampling=Sampling(control=True))
