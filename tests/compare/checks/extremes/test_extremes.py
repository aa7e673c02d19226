"""Every row of the table of extremes holds, and fails with a deliberate error in what it calls
(negative control)."""

import math
from dataclasses import replace

import numpy as np
import pytest
from commands import rattle

from rattle import Scene, closure, montecarlo
from rattle.compare.checks import extremes
from rattle.compare.checks.check import farthest, run_checks
from rattle.compare.checks.extremes import EXTREMES, extreme, runs
from rattle.compare.checks.published import noise
from rattle.compare.validation import validate as validation
from rattle.scene import flight, impact, long_orbit, orbit

LONG_ROWS = {
    "unit_of_length",
    "simultaneous",
    "sticking_paths",
    "collapse_drift",
    "absolute_times",
    "elastic_flights",
    "energy",
}
"""Rows that take seconds; with an error put in on purpose each is run shorter, in the first tier of
tests."""


@pytest.mark.parametrize(
    "name", [pytest.param(r, marks=pytest.mark.slow) if r in LONG_ROWS else r for r in EXTREMES]
)
def test_row_holds(name):
    (result,) = run_checks({name: EXTREMES[name]})
    assert result.holds, result


def early(found):
    """An orbit's next impact, a ten-millionth of the flight too early."""

    def next_impact(*args):
        t, *rest = found(*args)
        return (t * (1.0 - 1e-7), *rest)

    return next_impact


def swapped(scene, impacts):
    """An orbit that reports mesh 2 before mesh 1."""
    o = orbit_follow(scene, impacts)
    return replace(o, mesh=o.mesh[[0, 2, 1]])


orbit_follow = orbit.follow
log_speeds = noise.log_speeds
simulate = montecarlo.simulate
noise_covariance = flight.noise_covariance
mean_map = closure.mean_map
validate = validation.validate


def outside_walls(scene, **settings):
    """A simulation whose paths are far outside the walls."""
    found = simulate(scene, **settings)
    sums = dict(found.result.sums)
    for name in sums.keys() & {"section", "fixed"}:
        sums[name] = replace(sums[name], mean=sums[name].mean + 1e3)
    return replace(found, result=replace(found.result, sums=sums))


class Drifting(long_orbit.LongOrbit):
    """An orbit that gains a billionth and a bit of its speed in a stretch, and of its phase."""

    def stretch(self, impacts, tangent=True):
        s = super().stretch(impacts, tangent)
        return s._replace(
            before=s.before * (1.0 + 3e-9), phase=s.phase + 3e-6, flight=s.flight * (1.0 + 1e-11)
        )


def louder_when_late(scene, **settings):
    return validate(
        scene.with_sigma(scene.sigma * (1.0 + 1e-6 * (scene.start.tau > 10.0))), **settings
    )


def late_sticking(scene, impacts):
    """Sticking phases that begin and end late by a fraction of 1e-8."""
    found = orbit_follow(scene, impacts)
    late = 1.0 + 1e-8
    phases = [p._replace(closed=p.closed * late, opened=p.opened * late) for p in found.sticking]
    return replace(found, sticking=tuple(phases))


OUTSIDE = (montecarlo, "simulate", outside_walls)
# by the remainder of a rounded period
ROUNDED_PHASE = (
    Scene,
    "phase",
    property(lambda scene: math.remainder(scene.start.tau, 2.0 * math.pi)),
)
DRIFTING = (long_orbit, "LongOrbit", Drifting)
LATE = (orbit, "follow", late_sticking)


NEGATIVE_CONTROLS = {
    "grazing": (impact, "next_impact", early(impact.next_impact)),
    "simultaneous": (orbit, "follow", swapped),
    "chatter_time": LATE,
    "sticking_end": LATE,
    "free_covariance": (flight, "noise_covariance", lambda *a: 1.3 * noise_covariance(*a)),
    "exit_times": (
        noise,
        "simulate",
        lambda s, **k: simulate(s.with_sigma(1.15 * s.sigma), **k),
    ),
    "collapse_drift": (noise, "log_speeds", lambda eps, *rest: log_speeds(0.8 * eps, *rest)),
    "stay_between_walls": OUTSIDE,
    "sticking_paths": OUTSIDE,
    "large_tolerances": (
        closure,
        "mean_map",
        lambda s, **k: mean_map(replace(s, tolerance=None), **k),
    ),
    "unit_of_length": (
        closure,
        "mean_map",
        lambda s, **k: mean_map(replace(s, gamma1=s.gamma1 + 1e-12), **k),
    ),
    "proportional_sds": (
        closure,
        "mean_map",
        lambda s, **k: mean_map(s.with_sigma(s.sigma + 1e-9), **k),
    ),
    "phases": ROUNDED_PHASE,
    "whole_periods": ROUNDED_PHASE,
    "absolute_times": (validation, "validate", louder_when_late),
    "energy": DRIFTING,
    "elastic_flights": DRIFTING,
    "periodic_motion": DRIFTING,
}
"""For each row, a function that it calls, with a deliberate error."""


@pytest.fixture
def shorter(monkeypatch):
    """Shorter rows, which suffice for a negative control."""
    short = {
        "LONG_RUN_IMPACTS": runs.STRETCH_IMPACTS,
        "LONG_RUN_PERIODS": runs.STRETCH_IMPACTS,
        "LENGTH_POWERS": (-26,),
        "START_TIMES": (1e12,),
        "EXITS": ((1.0, 1e-3),),
    }
    for name, value in short.items():
        monkeypatch.setattr(runs, name, value)


@pytest.mark.usefixtures("shorter")
@pytest.mark.parametrize("name", EXTREMES)
def test_row_rejects_its_negative_control(name, monkeypatch):
    monkeypatch.setattr(*NEGATIVE_CONTROLS[name])
    (result,) = run_checks({name: EXTREMES[name]})
    assert not result.holds


def fake(error, **texts):
    """A check at extreme values whose worst error is given."""
    about = {"name": "E", "quantity": "beta", "statement": "0 to 1e3", "reference": "a limit"}
    return extreme(lambda: [0.0, error], allowed=4.5, **(about | {"unit": "each"} | texts))


def test_table_says_what_failed(monkeypatch):
    monkeypatch.setattr(
        extremes,
        "EXTREMES",
        {"E": fake(2e-16), "exit": fake(7.0, name="exit", statement="1e-3 to 1e4")},
    )
    text = rattle("check", "extremes", code=1).output.splitlines()
    assert text[-1].startswith("1 of 2 results hold; 2 checks, 0 of them statistical; 0 of 0")
    assert "holds" in text[2]
    assert "FAILS" in text[3]
    assert text[5] == "exit (a limit): 1e-3 to 1e4"
    assert "E (a limit): 0 to 1e3" in rattle("check extremes --all", code=1).output


def test_what_is_not_a_number_fails():
    (result,) = run_checks({"E": fake(math.nan)})
    assert not result.holds
    assert farthest([1.0, np.nan], [1.0, 2.0]) == math.inf
