from dataclasses import replace
from math import cos, exp, sin

import numpy as np
import pytest
from reference_moments import stage_moments_after_flight, window_shift
from refusals import refusal
from scenes import PAPER_SIGMA, dat21

from rattle import Scene, Start, Tolerance, mean_map

QUIET_SIGMA = 0.02


def published(sigma, **settings):
    return mean_map(dat21(sigma, **settings), closure="published")


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
    thrown = (-c.epsilon * y1 - here - d1) * (1 - e1) / c.beta1
    x1_next = x1 + thrown + c.alpha * (sin(tau + t) - sin(tau)) + d1 * t + new[0]
    y1_next = (
        (-c.epsilon * mean[1] - here - d1) * e1 + d1 + later + new[1] + c.epsilon * old[1] * e1
    )
    pulled = (y2 - y1 + here + d2) * (1 - e2) / c.beta2
    x2_next = x2 + pulled + (d1 - d2) * t + thrown + new[2]
    y2_next = (
        (mean[3] - (1 + c.epsilon) * mean[1] - here - d1) * e1
        + (mean[3] - mean[1] + here + d2) * e2
        + (d1 - d2)
        + (new[3] - old[3] * e2 - old[3] * e2)
        + ((1 + c.epsilon) * e1 + e2) * old[1]
    )
    return np.array([x1_next, y1_next, x2_next, y2_next])


def impact_of_moments(c, first, second, stages):
    """Eqs. 15 and 17 as published; where there is no stage 2, Eq. 15 too is to the power one
    whatever the moment."""
    first = first.copy()
    second = second.copy()
    if stages == 2:
        first[:, 1:] -= (1 + c.epsilon) * c.mu * second[:, 1:]
    else:
        first[:, 1:] *= -c.epsilon
    second[:, 1:] *= -c.epsilon
    return first, second


def follow_by_hand(scene, taus):
    """Means and moments at the given impact times by Eqs. 14-17, 20-22."""
    # the lines of an absent stage divide by its damping
    c = scene if scene.stages == 2 else replace(scene, beta2=1.0)
    absent = 2 - scene.stages
    windows = [*scene.windows, *[0.5] * absent]
    after = [np.diag([1.0, 0.0, 0.0, 0.0, 0.0])] * 2
    mean = np.append(scene.start_state, np.zeros(2 * absent))
    shift = np.zeros(4)
    rows = []
    for tau, t in zip(taus, np.diff(taus), strict=False):
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
        after = impact_of_moments(c, first, second, scene.stages)
        rows.append((mean, first, second))
    return rows


WITHIN = np.add.outer(range(5), range(5)) < 5


@pytest.mark.parametrize("stages", [1, 2])
@pytest.mark.parametrize("sigma", [0.0, QUIET_SIGMA, PAPER_SIGMA])
def test_means_and_moments_are_those_of_eqs_14_to_22(sigma, stages):
    # which widens the windows
    scene = dat21(sigma, stages=stages, tolerance=Tolerance(0.1, 0.1))
    trace = mean_map(scene, impacts=4, closure="published").trace
    rows = follow_by_hand(scene, trace.tau)
    assert stages == 2 or set(trace.mesh) == {1}
    for k, (mean, *raw) in enumerate(rows, 1):
        # the integrator holds 1e-11 of the moments; near a vanishing variance a shift magnifies
        # that
        assert trace.mean[k] == pytest.approx(mean[: 2 * stages], rel=1e-7, abs=1e-9)
        for found, exact in zip(trace.raw[k], raw, strict=False):
            assert found[WITHIN] == pytest.approx(exact[WITHIN], rel=1e-8, abs=1e-9)


@pytest.mark.parametrize("stages", [1, 2])
@pytest.mark.parametrize("sigma", [QUIET_SIGMA, PAPER_SIGMA])
def test_every_impact_is_at_the_first_counter_mesh(sigma, stages):
    """On a grid twenty times finer than the scan: E[x_i] + E[x_i]_k does not change its sign
    before."""
    m = published(sigma, stages=stages)
    t = m.trace
    for k in range(1, t.found + 1):
        begin, end = t.tau[k - 1 : k + 1]
        before = t.mean[k - 1, ::2]
        struck = t.mesh[k] - 1
        assert t.mean[k, 2 * struck] == pytest.approx(-before[struck], rel=0, abs=1e-10)
        times = np.linspace(begin, end, 20 + int((end - begin) / 0.0025))[1:-1]
        along = m.at_times(times)[["x1", "x2"][:stages]]
        assert ((along + before) * before > 0.0).all(axis=None), k


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
