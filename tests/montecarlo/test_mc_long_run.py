"""The long run: unbiased, with honest errors, independent of threads, and refused where there is
none."""

import math
from dataclasses import replace

import numpy as np
import pytest
from mc_checks import Walk
from refusals import refusal
from scenes import dat21, tree

from rattle import Record, Scene, Start, Tolerance, simulate
from rattle.montecarlo.long_run.estimates import all_names
from rattle.montecarlo.long_run.noise_work import CONTROLS
from rattle.montecarlo.long_run.run import long_run
from rattle.montecarlo.long_run.sums import FLIGHT, NOISE, OF_SPEED, scales_of_pilot

LONG_SCENE = dat21(0.5)


@pytest.fixture(scope="module")
def run():
    return long_run(LONG_SCENE, periods=128, paths=128, rng=3)


def test_every_quantity_is_there_and_consistent(run):
    e = {name: estimate.value for name, estimate in run.estimates.items()}
    assert e["rate"] == pytest.approx(e["rate_mesh1"] + e["rate_mesh2"])
    powers = [e["power_mesh1"] + e["power_mesh2"], e["rate"] * e["energy"]]
    powers.append(e["energy_per_period"] / (2.0 * math.pi))
    assert powers == pytest.approx([e["power"]] * 3)
    for mesh, mass in ((1, 1.0), (2, LONG_SCENE.mu)):  # reduced, in that of wheel 1's rim
        square = e[f"speed_mesh{mesh}"] ** 2 + e[f"sd_speed_mesh{mesh}"] ** 2
        assert e[f"rms_speed_mesh{mesh}"] ** 2 == pytest.approx(square, rel=1e-9)
        lost = 0.5 * mass * (1.0 - LONG_SCENE.epsilon**2) * square
        assert e[f"energy_mesh{mesh}"] == pytest.approx(lost, rel=1e-3)
        quantiles = [e[f"q{q:02d}_speed_mesh{mesh}"] for q in (1, 5, 50, 95, 99)]
        assert quantiles == sorted(quantiles)


def test_sections_are_densities_of_all_impacts(run):
    for d in run.densities:
        area = np.outer(np.diff(d.phase), np.diff(d.velocity))
        assert (d.density * area).sum() + d.outside == pytest.approx(1.0)
        marginal, se = run.velocity_density(d.mesh)
        assert marginal == pytest.approx(np.diff(d.phase) @ d.density)
        assert (se[marginal > 0.0] > 0.0).all()
        assert d.outside < 1e-3


def test_batch_means_confirm_the_errors(run):
    """Each is known to about 1 / sqrt(2 * 127), and batches remember a little."""
    both = [e.se_batches / e.se for e in run.estimates.values() if e.se > 0.0 < e.se_batches]
    assert len(both) > 10
    assert 0.7 < min(both) <= max(both) < 1.4


def test_result_does_not_depend_on_threads_or_on_room(run, monkeypatch):
    again = long_run(LONG_SCENE, periods=128, paths=128, rng=3, workers=2)
    assert again.estimates == run.estimates
    for room in (4, 24):  # all paths have more impacts than that in a period, a few
        monkeypatch.setattr("rattle.montecarlo.long_run.walk.IMPACT_ROOM", room)
        other = long_run(LONG_SCENE, periods=128, paths=128, rng=3)
        assert other.estimates == run.estimates


def test_agrees_with_the_late_impacts_of_simulate(run):
    """Another code path to the same motion, the 60th impact of many short paths; a fifth more is
    noticed."""
    record = Record(energy=True)
    late = simulate(LONG_SCENE, paths=2048, impacts=60, rng=5, record=record).section.loc[40:60]
    for name in ("flight", "energy"):
        mean = late[name].mean()
        e = run.estimates[name]
        allowed = 4.5 * math.hypot(late[f"se_{name}"].mean(), e.se)
        assert abs(mean - e.value) < allowed < abs(1.2 * mean - e.value)


def test_accuracy_is_reached_and_stated():
    found = long_run(LONG_SCENE, accuracy=0.02, quantities=["rate"], paths=64)
    e = found.estimates["rate"]
    assert found.reach.reached
    assert 0.5 * (e.high - e.low) <= 0.02 * e.value
    assert "reached" in found.reach.sentence


@pytest.mark.parametrize(
    ("settings", "field"),
    [
        ({"accuracy": 0.1, "periods": 100}, "periods"),
        ({"periods": 3}, "periods"),
        ({"paths": 4}, "paths"),
        ({"quantities": ["ratio"]}, "quantities"),
        ({"slow": 0.0}, "slow"),
        ({"burn_in": 0}, "burn_in"),
    ],
)
def test_bad_settings_are_refused(settings, field):
    with refusal(field=field):
        long_run(LONG_SCENE, **settings)


def test_burn_in_that_is_too_short_is_refused_with_a_longer_one():
    """Elastic walls: a fast start is forgotten by weak damping alone, over 32 periods."""
    start = Start(0.0, 0.5, 20.0, mesh=1)
    slow = Scene(alpha=0.0, epsilon=1.0, beta1=0.005, gamma1=0.0, sigma=0.5, start=start, stages=1)
    with refusal("give at least", "burn_in"):
        long_run(slow, periods=64, burn_in=4, paths=64)


def test_paths_that_little_noise_does_not_mix_are_refused(monkeypatch):
    """DAT21 at a small excitation: the approach to its orbits is seen over 64 periods."""
    monkeypatch.setattr("rattle.montecarlo.long_run.run.LONGEST_BURN_IN", 64)
    walled = replace(LONG_SCENE.with_sigma(1e-6), alpha=0.5)
    with refusal(r"burn_in = 64: .* give at least"):
        long_run(walled, periods=64, paths=64)


def test_walls_that_are_drawn_anew(run):
    """Those of each path are in the scatter between gear sets."""
    scene = dat21(0.5, tolerance=Tolerance(c1_max=0.1, c2_max=0.1, draw="contact"))
    found = long_run(scene, periods=64, paths=64)
    assert found.estimates["rate"].value == pytest.approx(run.estimates["rate"].value, rel=0.05)
    assert found.burn_in.apart is not None


def test_an_elastic_box_is_open_where_its_uniform_displacement_is():
    """Without drag and with restitution 1 the displacement is uniform: 0.98 of the time no flank is
    within 1 %."""
    box = Scene(alpha=0.0, epsilon=1.0, beta1=0.3, gamma1=0.0, sigma=1.0, stages=1)
    estimates = long_run(box, periods=64, paths=64, rng=5).estimates
    found = estimates["open_share_mesh1"]
    assert abs(found.value - 0.98) < 4.0 * found.se < 0.01
    assert found.low <= found.value <= found.high
    assert not any("mesh2" in name for name in estimates)


def test_a_tree_has_all_quantities_and_controls_of_mean_zero():
    """The sums of what the noise does, which estimates are freed of."""
    found = long_run(tree((0, 1, 1, 0), alpha=1.5, sigma=1.0), periods=64, paths=64, rng=2)
    assert tuple(found.estimates) == all_names(4)
    work = found.sums.main[:, :, NOISE : NOISE + CONTROLS].sum(axis=1)
    z = work.mean(axis=0) / work.std(axis=0, ddof=1) * 8.0  # the root of 64 paths
    assert (np.abs(z) < 4.0).all()
    assert [d.mesh for d in found.densities] == [1, 2, 3, 4]


PERIOD_SECONDS = 1.0  # of a block of paths and a period


class Watched:
    """A clock that each period of all paths moves on; what compiles is not counted."""

    def __init__(self, monkeypatch):
        self.now = 0.0
        follow = Walk.follow
        monkeypatch.setattr("rattle.montecarlo.kernel.blocks.time.process_time", lambda: self.now)

        def followed(walk, sums, periods=1, length=1, seen=None):
            first = walk.paths > 1 and walk.first == 0
            self.now += PERIOD_SECONDS * periods * first
            follow(walk, sums, periods, length, seen)

        monkeypatch.setattr(Walk, "follow", followed)


@pytest.mark.parametrize("budget", [5.0, 60.0, 120.0])
def test_a_budget_gives_the_best_answer_that_it_allows(monkeypatch, budget):
    """Half of it goes into a burn-in that does not fit; then the answer says so, and intervals are
    wider by the drift that was seen, twice at the least."""
    watched = Watched(monkeypatch)
    found = long_run(LONG_SCENE, accuracy=1e-9, paths=16, budget=budget, burn_in=32)
    assert watched.now <= 1.1 * budget + PERIOD_SECONDS
    # less than a period of all paths may be left
    assert watched.now >= 0.9 * budget - PERIOD_SECONDS
    assert found.periods + found.burn_in.periods <= 1.1 * budget + 1.0
    assert not found.reached
    assert found.burn_in.reached == (budget > 64.0)
    if found.burn_in.reached:
        assert found.reach.more_seconds > budget
        assert "more would suffice" in found.reach.sentence
    else:
        assert "The start may not be forgotten" in found.burn_in.sentence
        rate, forgotten = (one.estimates["rate"] for one in (found, replace(found, widened=1.0)))
        wider = (rate.high - rate.low) / (forgotten.high - forgotten.low)
        assert 2.0 <= found.widened == pytest.approx(wider)


def test_without_a_budget_no_clock_decides(monkeypatch):
    monkeypatch.setattr("rattle.montecarlo.long_run.paths.IMPACT_SECONDS", 1.0)
    with refusal("without a budget the limit is one hour: ask for"):
        long_run(LONG_SCENE, accuracy=1e-3, paths=16, burn_in=32)
    monkeypatch.setattr("rattle.montecarlo.long_run.paths.IMPACT_SECONDS", 1e-9)
    Watched(monkeypatch)
    monkeypatch.setitem(globals(), "PERIOD_SECONDS", 1e6)
    assert long_run(LONG_SCENE, accuracy=0.1, paths=16, burn_in=32).reach.reached


def test_a_mesh_that_the_pilot_run_did_not_see_struck_has_the_scales_of_all_impacts():
    """Mesh 3 had no impact, mesh 2 slow ones only: speeds of all meshes are added up."""
    mesh, flight, phase, share = np.random.default_rng(1).random((4, 500))
    fast = mesh < 0.5
    speed = np.where(fast, 1.0 + share, 0.05 * share)
    scales = scales_of_pilot(3, np.column_stack([2.0 - fast, phase, flight, speed]), 0.1)
    for of in (scales.centre, scales.scale, scales.edges, scales.first):
        assert (of[1:, OF_SPEED:] == of[0, OF_SPEED:]).all()
        assert (of[3, FLIGHT] == of[0, FLIGHT]).all()
    assert scales.centre[2, FLIGHT] != scales.centre[0, FLIGHT]
    assert (np.diff(scales.edges[3]) > 0.0).any(axis=1).all()
