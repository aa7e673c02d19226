"""The expected cost of an accuracy is logged before the work; a budget bounds it, pilot runs
included.

The clock of these tests ticks with the blocks of paths that are run, so that no machine is too slow
for them.
"""

import logging
import re

import pytest
from mc_checks import BLOCK, in_threads
from refusals import refusal
from scenes import dat21

from rattle import Sampling, Scene, Start, simulate_to
from rattle.montecarlo import AccuracyWarning


class Watched:
    """Blocks on one thread, and a clock that each of them moves on."""

    def __init__(self, monkeypatch, seconds=lambda paths: 1.0):
        self.now = 0.0
        self.seconds = seconds
        self.paths = []
        monkeypatch.setattr("rattle.montecarlo.kernel.blocks.time.process_time", lambda: self.now)

    def __call__(self, plan, first):
        for block, result in enumerate(in_threads(1)(plan, first), start=first):
            self.paths.append(min(BLOCK, plan.paths - block * BLOCK))
            self.now += self.seconds(self.paths[-1])
            yield result


def ask(watched, accuracy, **settings):
    return simulate_to(
        dat21(0.5), accuracy, impacts=2, rng=5, sampling=Sampling(blocks=watched), **settings
    )


def test_paths_are_followed_until_the_budget_is_spent(monkeypatch):
    watched = Watched(monkeypatch)
    said = "Accuracy 1e-09 sd NOT reached: .* years of processor time more would suffice"
    with pytest.warns(AccuracyWarning, match=said):
        run = ask(watched, 1e-9, budget=10.0, scheme="exact-flight")
    assert watched.now == 11.0  # the first run, which compiles, is not counted
    assert run.paths == run.plan.paths == 5 * BLOCK
    assert run.diagnostics[0] == run.reach.sentence
    assert run.reach.sampling > 1e-9
    assert "from fewer paths or a shorter time than an answer needs" in run.reach.sentence


def test_a_step_is_no_shorter_than_the_budget_affords(monkeypatch):
    """At once as short as the accuracy asks, it would have been 1e-9 of the pilot's, and a block an
    hour long."""
    watched = Watched(monkeypatch)
    with pytest.warns(AccuracyWarning):
        run = ask(watched, 1e-9, budget=10.0, scheme="euler-maruyama")
    assert watched.now <= 11.0
    assert run.dt > 1e-6
    assert run.reach.more_seconds > 1e9


def test_a_pilot_is_not_run_where_probe_runs_show_that_the_budget_has_no_room_for_it(monkeypatch):
    watched = Watched(monkeypatch, lambda paths: float(paths))
    with pytest.warns(AccuracyWarning):
        run = ask(watched, 0.1, budget=20.0)
    assert watched.paths == [1, 1, 1, 8, 8]
    assert (run.paths, run.scheme) == (8, "exact-flight")
    assert list(run.reach.schemes.index) == ["exact-flight"]
    assert run.reach.more_seconds > 2e4


@pytest.mark.parametrize("sigma", [0.0, 1.0])
def test_paths_that_take_ten_million_steps_are_looked_at_from_the_start(sigma):
    """Damping so fast that a step is 1e-5, and a gap that nobody crosses: eight paths of it would
    take seconds."""
    slow = {"alpha": 0.1, "epsilon": 0.5, "beta1": 1e4, "gamma1": 0.0, "gap1": 1e3, "stages": 1}
    scene = Scene(**slow, sigma=sigma, start=Start(0.0, 0.0, 0.0))
    with pytest.warns(AccuracyWarning):
        run = simulate_to(scene, 1e-3, impacts=12, budget=1.0, scheme="euler-maruyama-located")
    assert run.unfinished == run.paths == (8 if sigma else 1)
    assert run.path_steps < 4e6  # of 4e8 to the horizon
    assert run.reach.more_seconds > 1.0
    assert any("before the time limit" in said for said in run.diagnostics)


def test_what_takes_more_than_an_hour_is_refused_unless_a_budget_is_given(monkeypatch):
    watched = Watched(monkeypatch)
    said = r"accuracy = 1e-09: is expected to take .* years \(about .* of processor"
    with refusal(f"^{said}.*give the seconds that it may take as budget$") as refused:
        ask(watched, 1e-9, workers=2)
    assert max(watched.paths) <= BLOCK
    assert sum(watched.paths) < 48 * BLOCK  # pilots alone, those near rare branches too
    (gives,) = re.findall(r"ask for ([^,]*),", str(refused.value))
    assert ask(in_threads(1), 100.0 * float(gives)).reach.reached


def test_slow_paths_are_refused_before_a_pilot(monkeypatch):
    watched = Watched(monkeypatch, lambda paths: float(paths))
    with refusal(r"is expected to take .* limit is one hour: give the"):
        ask(watched, 0.1)
    assert watched.paths == [1, 1, 1, 8, 8, 256]


def test_other_schemes_are_not_tried_without_a_budget_for_them(monkeypatch):
    monkeypatch.setattr("rattle.montecarlo.accuracy.pilots.CHEAP_SECONDS", 0.0)
    with pytest.warns(AccuracyWarning):
        run = ask(Watched(monkeypatch, lambda paths: 3.0), 1e-3, budget=20.0)
    assert list(run.reach.schemes.index) == ["exact-flight"]


def test_the_estimate_is_said_before_the_work(monkeypatch, caplog):
    watched = Watched(monkeypatch)
    with caplog.at_level(logging.INFO, "rattle.estimate"):
        run = ask(watched, 0.02)
    (said,) = caplog.messages
    assert said == f"Accuracy 0.02 sd: {run.reach.expected.sentence}."
    assert "of processor time: exact-flight, dt = 0.0327, " in said
