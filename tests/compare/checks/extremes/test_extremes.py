"""Every row of the table of extremes holds, and fails with a deliberate error in what it calls
(negative control)."""

import math
from dataclasses import replace

import numpy as np
import pytest
from commands import rattle

from rattle import closure, montecarlo
from rattle.closure import edgeworth, saltation
from rattle.compare.checks import extremes
from rattle.compare.checks.check import extreme, extreme_record, farthest, result_lines
from rattle.compare.checks.extremes import ROWS, formulas, runs
from rattle.compare.checks.published import noise
from rattle.compare.validation import validate as validation
from rattle.montecarlo.schemes import short_flight as short
from rattle.scene import Scene, damping, drive, flight, impact, long_orbit, moments, orbit, tangent

LONG = {
    "unit_of_length",
    "simultaneous",
    "sticking_paths",
    "collapse_drift",
    "absolute_times",
    "step_noise",
    "elastic_flights",
    "energy",
}
"""Rows that take seconds; with an error put in on purpose each is run shorter, in the first tier of
tests."""


@pytest.mark.parametrize(
    "name", [pytest.param(r, marks=pytest.mark.slow) if r in LONG else r for r in ROWS]
)
def test_row_holds(name):
    row = ROWS[name]()
    assert row.holds, row
    assert row.allowed <= (5.0 if row.unit == "z" else 1.0)


def cancelling(c, t):
    """The Jacobian with cancelling differences of nearly equal terms."""
    j = jacobian(c, t)
    j[2, 1] = damping.phi1(c.beta1, t) - damping.phi1(c.beta2, t)
    j[3, 1] = math.exp(-c.beta1 * t) - math.exp(-c.beta2 * t)
    return j


def plain_displacement(c, tau, y1, y2, t):
    """Eq. 3 as it stands: phi1 times alpha cos tau - y1, which cancels in a short flight."""
    u1 = c.alpha * math.cos(tau) - y1
    u2 = u1 + y2
    e1, d1 = damping.damp(c.beta1, t)
    e2, d2 = damping.damp(c.beta2, t)
    s1 = u1 * e1 - c.gamma1 * damping.phi2(c.beta1, t)
    s2 = u2 * e2 - c.gamma2 * damping.phi2(c.beta2, t)
    v1 = u1 * d1 - c.gamma1 * e1
    v2 = u2 * d2 - c.gamma2 * e2
    return (
        c.alpha * (math.sin(tau + t) - math.sin(tau)) - s1,
        c.alpha * math.cos(tau + t) - v1,
        s2 - s1,
        v2 - v1,
    )


def masses_by_difference(low, high, order):
    """Window moments as differences of their ends, and mass as a difference of error functions."""
    edges = [
        [edgeworth.hermite(i, z) * edgeworth.normal_density(z) for i in range(order + 1)]
        for z in (low, high)
    ]
    mass = [0.5 * (math.erf(high / math.sqrt(2.0)) - math.erf(low / math.sqrt(2.0)))]
    mass += [edges[0][i] - edges[1][i] for i in range(order + 1)]
    return mass, [mass[i + 1] + (i * mass[i - 1] if i else 0.0) for i in range(order + 1)]


def wrong_windows(a, sd_x, sd_y, low, high):
    mass, first = masses_by_difference(low / sd_x, high / sd_x, len(a) - 1)
    return sd_x * sum(a[:, 0] * first), sd_y * sum(a[:-1, 1] * mass[: len(a) - 1])


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
tangent_matrix = tangent.saltation_matrix
short_flight = short.short_flight
returned = noise.log_speeds
jacobian = flight.jacobian
realizability = moments.realizability
simulate = montecarlo.simulate
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


def by_floats(self):
    """The phase by the remainder of a rounded period."""
    return math.remainder(self.start.tau, 2.0 * math.pi)


def off(function, factor):
    """A function whose result is off by a factor."""

    def wrong(*args, **settings):
        found = function(*args, **settings)
        return tuple(factor * v for v in found) if isinstance(found, tuple) else factor * found

    return wrong


def differenced(c, tau, t):
    """The slope by a finite difference that suffers from rounding."""
    step = 1e-7
    return (
        flight.noise_covariance(c, tau + step, t) - flight.noise_covariance(c, tau - step, t)
    ) / (2.0 * step)


def absolutely_judged(covariance):
    """A verdict by the smallest eigenvalue relative to the largest variance, although x and y have
    different units."""
    judged = realizability(covariance)
    bound = -moments.RHO_ROUNDING * max(covariance[0, 0], covariance[1, 1])
    return judged._replace(realizable=abs(judged.rho) <= 1.0 or judged.smallest_eigenvalue >= bound)


def harder(c, *rest):
    return tangent_matrix(c._replace(epsilon=c.epsilon + 1e-12), *rest)


def louder_when_late(scene, **settings):
    return validate(
        scene.with_sigma(scene.sigma * (1.0 + 1e-6 * (scene.start.tau > 10.0))), **settings
    )


def late_sticking(scene, impacts):
    """Sticking phases that begin and end late by a fraction of 1e-8."""
    found = orbit_follow(scene, impacts)
    late = 1.0 + 1e-8
    return replace(
        found,
        sticking=tuple(
            p._replace(closed=p.closed * late, opened=p.opened * late) for p in found.sticking
        ),
    )


NEGATIVE_CONTROLS = {
    "phi_functions": (
        damping,
        "phi2",
        lambda beta, t: (t - damping.phi1(beta, t)) / beta if beta else 0.5 * t * t,
    ),
    "flight_state": (flight, "displacement", plain_displacement),
    "flight_jacobian": (flight, "jacobian", cancelling),
    "flight_noise": (flight, "noise_covariance", off(flight.noise_covariance, 1.0 + 1e-12)),
    "noise_phase_derivative": (saltation, "noise_slope", differenced),
    "saltation": (tangent, "saltation_matrix", harder),
    "grazing": (impact, "next_impact", early(impact.next_impact)),
    "simultaneous": (orbit, "follow", swapped),
    "chatter_time": (orbit, "follow", late_sticking),
    "sticking_end": (orbit, "follow", late_sticking),
    "edgeworth_windows": (edgeworth, "window_means", wrong_windows),
    "correlations": (moments, "realizability", absolutely_judged),
    "step_phase": (drive, "sine_cosine", lambda tau: (math.sin(tau + 1e-13), math.cos(tau))),
    "step_flight": (
        short,
        "short_flight",
        lambda c, *a: short_flight(c._replace(beta2=c.beta2 * (1.0 + 1e-12)), *a),
    ),
    "step_noise": (short, "kick", off(short.kick, 1.0 + 1e-6)),
    "exit_times": (
        montecarlo,
        "simulate",
        lambda s, **k: simulate(s.with_sigma(1.15 * s.sigma), **k),
    ),
    "collapse_drift": (noise, "log_speeds", lambda epsilon, *rest: returned(0.8 * epsilon, *rest)),
    "stay_between_walls": (montecarlo, "simulate", outside_walls),
    "sticking_paths": (montecarlo, "simulate", outside_walls),
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
    "phases": (Scene, "phase", property(by_floats)),
    "whole_periods": (Scene, "phase", property(by_floats)),
    "absolute_times": (validation, "validate", louder_when_late),
    "energy": (long_orbit, "LongOrbit", Drifting),
    "elastic_flights": (long_orbit, "LongOrbit", Drifting),
    "periodic_motion": (long_orbit, "LongOrbit", Drifting),
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
    }
    for name, value in short.items():
        monkeypatch.setattr(runs, name, value)
    monkeypatch.setattr(formulas, "POINTS_OF_A_ROW", 60)
    monkeypatch.setattr(runs, "EXITS", ((1.0, 1e-3),))


@pytest.mark.usefixtures("shorter")
@pytest.mark.parametrize("name", ROWS)
def test_row_rejects_its_negative_control(name, monkeypatch):
    monkeypatch.setattr(*NEGATIVE_CONTROLS[name])
    assert not ROWS[name]().holds


def test_table_and_terminal_say_what_failed(monkeypatch):
    good = extreme(name="E", field="beta", tried="0 to 1e3", truth="mpmath")(lambda: [2e-16])
    bad = extreme(
        4.5, name="exit", field="sigma", tried="1e-3 to 1e4", truth="a formula", unit="z"
    )(lambda: [7.0])
    found = [extreme_record(row()) for row in (good, bad)]
    assert [row["holds"] for row in found] == [True, False]
    assert list(found[0]) == [
        "name",
        "field",
        "tried",
        "truth",
        "worst",
        "allowed",
        "unit",
        "holds",
    ]
    text = result_lines([good(), bad()])
    assert text[-1].startswith("1 of 2 results hold; 2 checks, 1 of them statistical")
    assert ("holds" in text[2], "FAILS" in text[3]) == (True, True)
    assert text[5] == "exit (a formula): 1e-3 to 1e4"
    monkeypatch.setattr(extremes, "ROWS", {"good": good})
    rattle("check", "extremes", "--all")


def test_what_is_not_a_number_fails():
    assert not extreme(1.0, name="E", field="beta", tried="", truth="")(
        lambda: [0.0, math.nan]
    )().holds
    assert farthest([1.0, np.nan], [1.0, 2.0]) == math.inf
