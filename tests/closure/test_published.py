from dataclasses import replace
from math import cos, exp, sin

import numpy as np
import pytest
from reference_moments import stage_moments_after_flight, window_shift
from refusals import refusal
from scenes import PAPER_SIGMA, dat21

from rattle import DAT21, Scene, Start, Tolerance, mean_map

IMPACTS_BY_HAND = 12
QUIET_SIGMA = 0.02


def published(sigma, impacts=IMPACTS_BY_HAND, **settings):
    return mean_map(
        Scene.from_gears(DAT21, sigma=sigma, **settings), impacts=impacts, closure="published"
    )


def eq_22(c, tau, t, mean, old, new):
    """The four lines of Eq. 22 with Eq. 10, in gamma/beta form; `old`, `new` are the shifts sigma A
    to sigma D."""
    x1, y1, x2, y2 = np.array(mean) - old
    e1 = exp(-c.beta1 * t)
    e2 = exp(-c.beta2 * t)
    d1 = c.gamma1 / c.beta1
    d2 = c.gamma2 / c.beta2
    here = c.alpha * cos(tau)
    later = c.alpha * cos(tau + t)
    sine = c.alpha * (sin(tau + t) - sin(tau))
    x1_next = x1 + (-c.epsilon * y1 - here - d1) * (1 - e1) / c.beta1 + sine + d1 * t + new[0]
    y1_next = (
        (-c.epsilon * mean[1] - here - d1) * e1 + d1 + later + new[1] + c.epsilon * old[1] * e1
    )
    x2_next = (
        x2
        + (y2 - y1 + here + d2) * (1 - e2) / c.beta2
        + (d1 - d2) * t
        + (-c.epsilon * y1 - here - d1) * (1 - e1) / c.beta1
        + new[2]
    )
    y2_next = (
        (mean[3] - (1 + c.epsilon) * mean[1] - here - d1) * e1
        + (mean[3] - mean[1] + here + d2) * e2
        + (d1 - d2)
        + (new[3] - old[3] * e2 - old[3] * e2)
        + ((1 + c.epsilon) * e1 + e2) * old[1]
    )
    return np.array([x1_next, y1_next, x2_next, y2_next])


def impact_of_moments(c, first, second):
    """Eqs. 15 and 17 as published."""
    kappa = (1 + c.epsilon) * c.mu
    first = first.copy()
    second = second.copy()
    first[:, 1:] -= kappa * second[:, 1:]
    second[:, 1:] *= -c.epsilon
    return first, second


def follow_by_hand(scene, taus, impacts, contact=impact_of_moments):
    """Means and moments at the given impact times by Eqs. 14-17, 20-22."""
    # the lines of an absent stage divide by its damping
    c = scene if scene.stages == 2 else replace(scene, beta2=1.0)
    absent = 2 - scene.stages
    windows = [*scene.windows, *[0.5] * absent]
    zero = np.zeros((5, 5))
    zero[0, 0] = 1.0
    after = (zero, zero)
    mean = np.append(scene.start_state, np.zeros(2 * absent))
    shift = np.zeros(4)
    rows = []
    for k in range(1, impacts + 1):
        tau = taus[k - 1]
        t = taus[k] - taus[k - 1]
        first = stage_moments_after_flight(
            after[0], c.beta1, tau, t, lambda s: c.sigma**2 * (-sin(s) + c.beta1 * cos(s)) ** 2
        )
        second = stage_moments_after_flight(after[1], c.beta2, tau, t, lambda s: c.sigma**2)
        # those of Eq. 10: without the new shift
        x1, x2 = eq_22(c, tau, t, mean, shift, np.zeros(4))[[0, 2]]
        new = np.array(
            [*window_shift(first, x1, windows[0]), *window_shift(second, x2, windows[1])]
        )
        mean = eq_22(c, tau, t, mean, shift, new)
        shift = new
        after = contact(c, first, second)
        rows.append((mean, first, second))
    return rows


def impact_of_one_stage(c, first, second):
    """Eq. 15 where there is no stage 2: as published, to the power one whatever the moment."""
    first = first.copy()
    first[:, 1:] *= -c.epsilon
    return first, second


CONTACTS = {1: impact_of_one_stage, 2: impact_of_moments}


@pytest.mark.parametrize("stages", CONTACTS)
@pytest.mark.parametrize("sigma", [0.0, QUIET_SIGMA, PAPER_SIGMA])
def test_means_and_moments_are_those_of_eqs_14_to_22(sigma, stages):
    # which widens the windows
    scene = dat21(sigma, stages=stages, tolerance=Tolerance(0.1, 0.1))
    trace = mean_map(scene, impacts=4, closure="published").trace
    rows = follow_by_hand(scene, trace.tau, 4, CONTACTS[stages])
    assert stages == 2 or set(trace.mesh) == {1}
    for k, (mean, *raw) in enumerate(rows, 1):
        # the integrator holds 1e-11 of the moments; near a vanishing variance a shift magnifies
        # that
        assert trace.mean[k] == pytest.approx(mean[: 2 * stages], rel=1e-7, abs=1e-9)
        for stage in range(stages):
            within = np.add.outer(np.arange(5), np.arange(5)) < 5
            assert trace.raw[k, stage][within] == pytest.approx(
                raw[stage][within], rel=1e-8, abs=1e-9
            )


@pytest.mark.parametrize("stages", [1, 2])
@pytest.mark.parametrize("sigma", [QUIET_SIGMA, PAPER_SIGMA])
def test_every_impact_is_at_the_first_counter_mesh(sigma, stages):
    """On a grid twenty times finer than the scan: E[x_i] + E[x_i]_k does not change its sign
    before."""
    m = published(sigma, stages=stages)
    t = m.trace
    for k in range(1, t.found + 1):
        struck = 2 * (t.mesh[k] - 1)
        assert t.mean[k, struck] == pytest.approx(-t.mean[k - 1, struck], rel=0, abs=1e-10)
        flight = t.tau[k] - t.tau[k - 1]
        times = t.tau[k - 1] + np.linspace(0.0, 1.0, max(int(flight / 0.0025), 20))[1:-1] * flight
        for name, before in zip(("x1", "x2")[:stages], t.mean[k - 1, ::2], strict=False):
            assert ((m.at_times(times)[name] + before) * before > 0.0).all(), (k, name)


@pytest.mark.parametrize(
    "start", [Start(), Start(x2=0.5, y2=1.0, mesh=2)], ids=["in flight", "mesh 2"]
)
def test_it_starts_at_mesh_1_only(start):
    with refusal(rf"start\.mesh = {start.mesh}: the published closure needs a start at mesh 1"):
        published(0.1, start=start)


def test_it_says_where_and_why_it_cannot_go_on():
    scene = Scene(
        alpha=0.0, epsilon=0.5, beta1=1.0, gamma1=0.0, stages=1, start=Start(0.0, 0.5, 0.1, mesh=1)
    )
    m = mean_map(scene, impacts=3, closure="published")
    assert m.stopped == "the other mesh is not struck within 20 time units after impact 0"
    assert m.section["tau"].isna().all()
    assert not m.section["realizable"].any()
