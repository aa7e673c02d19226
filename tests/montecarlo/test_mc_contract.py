"""What every scheme promises, whatever its order: one class of tests, run for each entry of
SCHEMES."""

import math
from dataclasses import replace

import numpy as np
import pytest
from mc_checks import (
    DAMPED,
    PRESSED,
    UNEQUAL_GAPS,
    agrees,
    dat21,
    flank_changes,
    open_space,
    orbit_of,
    stepped,
)
from oracle import gearbox
from settings import recorded

from rattle.montecarlo import SCHEMES
from rattle.scene import Scene, Start, Tolerance

STEP = {"euler-maruyama": 5e-3, "euler-maruyama-located": 5e-3, "exact-flight": math.pi / 64.0}
"""A step at which each scheme is of use."""

LOCATES = {"euler-maruyama": False, "euler-maruyama-located": True, "exact-flight": True}

STATE = ("x1", "y1", "x2", "y2")
PAIRS = [(i, j) for i in range(4) for j in range(i, 4)]
TIMES = np.array([0.5, 1.5, 3.0])

FREE = Scene(
    alpha=0.0,
    epsilon=1.0,
    beta1=0.0,
    gamma1=0.0,
    mu=0.3,
    gap1=0.5,
    gap2=0.4,
    start=Start(0.0, 0.1, 1.0, -0.2, -0.7),
    tolerance=Tolerance(0.2, 0.2, draw="contact"),
)
"""No forces and no losses; random walls make every path another one."""


def wheels(raw, mu):
    """Energy and momentum of the wheels just before each impact: masses 1 - mu and mu, u1 = -y1, u2
    = y2 - y1."""
    u1 = -raw[..., 3]
    u2 = raw[..., 5] - raw[..., 3]
    return (1.0 - mu) * u1**2 + mu * u2**2, (1.0 - mu) * u1 + mu * u2


def flight_moments(scene, scheme, dt, t):
    """Mean and covariance of a flight without walls, as the scheme has them."""
    s = scene.start
    box = gearbox(scene.constants)
    mean = np.array([s.x1, s.y1, s.x2, s.y2])
    covariance = np.zeros((4, 4))
    if not SCHEMES[scheme].has_step_bias:
        return box.fly(s.tau, mean, t), box.covariance(s.tau, covariance, t)
    matrix = np.eye(4) + dt * box.drift_matrix()
    for tau in s.tau + dt * np.arange(round(t / dt)):
        kick = scene.sigma * box.noise_direction(tau)
        mean = mean + dt * box.rates(tau, mean)
        covariance = matrix @ covariance @ matrix.T + dt * np.outer(kick, kick)
    return mean, covariance


@pytest.mark.parametrize("scheme", SCHEMES)
class TestScheme:
    """Each test takes the scheme's name."""

    def run(self, scheme, scene, **settings):
        settings = {
            "paths": 200,
            "impacts": 8,
            "dt": STEP[scheme],
            "rng": 2,
            "raw": True,
        } | settings
        return stepped(scene, scheme=scheme, **recorded(settings))

    # --- truths

    @pytest.mark.parametrize(
        "scene", [dat21(), UNEQUAL_GAPS, DAMPED], ids=["DAT21", "unequal gaps", "damped"]
    )
    def test_noise_free_path_converges_to_the_orbit(self, scheme, scene):
        """At first order within a bound for Euler's steps (a late detection jumps with dt); at once
        for exact ones."""
        orbit = orbit_of(scene, 5)
        exact = not SCHEMES[scheme].has_step_bias
        steps = (0.1 if exact else 2e-3) / 4.0 ** np.arange(5)
        errors = []
        for dt in steps:
            raw = self.run(scheme, scene, paths=1, impacts=5, dt=dt).raw[0]
            assert (raw[:, 6] == orbit[:, 5]).all()
            errors.append(np.abs(raw[:, [0, 2, 3, 4, 5]] - orbit[:, :5]).max())
        if exact:
            assert max(errors) < 1e-8
        else:
            assert (errors / steps).max() < 60.0
            assert errors[-1] < 0.03 * errors[0]

    def test_energy_is_conserved_on_every_path(self, scheme):
        raw = self.run(scheme, FREE, impacts=30, dt=0.02).raw
        energy, _ = wheels(raw, FREE.mu)
        assert np.abs(energy - ((1.0 - FREE.mu) * 1.0**2 + FREE.mu * 1.7**2)).max() < 1e-12
        assert np.ptp(raw[:, :, 3]) > 0.5  # the paths do differ
        assert (
            np.ptp(wheels(raw, FREE.mu + 0.01)[0]) > 1e-3
        )  # negative control: another share of the impulse

    @pytest.mark.parametrize("louder", [1.0, 1.03])
    def test_flight_without_walls_has_the_means_and_4d_covariance_of_the_scheme(
        self, scheme, louder
    ):
        """Means and covariances at fixed times, each with its standard error; negative control: 3 %
        more noise."""
        scene = open_space(0.4, beta2=0.9)
        paths = 20_000
        dt = 0.02
        noisy = replace(scene, sigma=louder * scene.sigma)
        run = self.run(
            scheme,
            noisy,
            paths=paths,
            impacts=1,
            dt=dt,
            horizon=4.0,
            times=scene.start.tau + TIMES,
            raw=False,
        )
        names = [*STATE, *(f"cov_{STATE[i]}_{STATE[j]}" for i, j in PAIRS)]
        found = run.at_times()[names].to_numpy()
        se = run.at_times()[[f"se_{n}" for n in names]].to_numpy()
        moments = [flight_moments(scene, scheme, dt, t) for t in TIMES]
        truth = np.array([[*mean, *(cov[i, j] for i, j in PAIRS)] for mean, cov in moments])
        assert agrees(found, truth, se, slack=1e-8) == (louder == 1.0)

    # --- paths and tables

    def test_single_stage_is_the_first_stage_of_a_pair_whose_second_never_touches(self, scheme):
        values = {
            n: getattr(dat21(), n)
            for n in ("alpha", "epsilon", "beta1", "beta2", "gamma1", "gamma2", "mu")
        }
        pair = Scene(**values, gap2=1e6, sigma=0.2, start=Start(0.0, 0.5, 2.0, 0.0, 0.0, mesh=1))
        lone, both = (self.run(scheme, s, impacts=6).raw for s in (dat21(0.2, stages=1), pair))
        assert np.abs(lone - both[:, :, [0, 1, 2, 3, 6]]).max() <= (
            1e-11 if scheme == "exact-flight" else 0.0
        )  # rounding, and its growth

    def test_no_path_runs_beyond_the_horizon_by_more_than_a_step(self, scheme):
        run = self.run(scheme, dat21(0.3), impacts=60, horizon=1.5)
        assert run.unfinished == 200
        assert np.nanmax(run.raw[:, :, 0]) <= 1.5 + STEP[scheme]
        steps = math.ceil(1.5 / STEP[scheme])
        assert run.path_steps == 200 * steps

    def test_seed_matters_where_there_is_noise_only(self, scheme):
        still, noisy = (
            [self.run(scheme, dat21(s), paths=3, rng=seed).raw for seed in (1, 2)]
            for s in (0.0, 0.1)
        )
        assert np.array_equal(*still, equal_nan=True)
        assert not np.array_equal(*noisy, equal_nan=True)

    # --- impacts that pile up

    def test_accumulating_impacts_return_and_are_counted(self, scheme):
        """Both meshes stick until the drive lifts them: impacts accumulate within a step, if they
        are located."""
        run = self.run(scheme, replace(PRESSED, alpha=4.0), paths=20, impacts=500)
        assert run.unfinished == 0
        assert (run.sticking_steps > 0) == LOCATES[scheme]
        assert np.isfinite(run.raw).all()
        assert (run.raw[:, :, 1] >= 0.0).all()

    @pytest.mark.parametrize("epsilon", [0.0, 0.02])
    def test_collapse_onto_the_wall_is_survived(self, scheme, epsilon):
        """Below a restitution of 0.163 a randomly accelerated particle collapses (Cornell, Swift &
        Bray 1998)."""
        scene = Scene(
            alpha=0.0,
            epsilon=epsilon,
            beta1=0.0,
            gamma1=0.0,
            sigma=1.0,
            stages=1,
            start=Start(-0.5 * math.pi, 0.5, 1.0, mesh=1),
        )
        run = self.run(scheme, scene, impacts=40, horizon=20.0)
        reached = np.isfinite(run.raw[:, :, 0])
        assert run.unfinished + reached[:, -1].sum() == 200
        assert reached[:, -1].sum() > 100
        assert (np.abs(run.raw[:, :, 2][reached]) == 0.5).all()
        assert np.isfinite(run.raw[:, :, :4][reached]).all()

    # --- walls

    @pytest.mark.parametrize("draw", ["path", "contact"])
    def test_fixed_tolerance_is_a_wider_gap(self, scheme, draw):
        tolerant = self.run(
            scheme, dat21(0.3, tolerance=Tolerance(0.04, 0.02, distribution="fixed", draw=draw))
        )
        wider = replace(
            dat21(0.3), gap1=0.54, gap2=0.52, start=Start(0.0, 0.54, 2.0, 0.52, 2.0, mesh=1)
        )
        assert np.array_equal(tolerant.raw, self.run(scheme, wider).raw)

    @pytest.mark.parametrize("mesh", [1, 2])
    def test_a_flank_is_redrawn_when_and_only_when_the_opposite_is_struck(self, scheme, mesh):
        raw = self.run(
            scheme, dat21(0.5, tolerance=Tolerance(0.04, 0.02, draw="contact")), impacts=40
        ).raw
        moved, between = flank_changes(raw, mesh)
        assert np.array_equal(moved, between)
        assert 200 < sum(between) < len(between) - 200  # both happened

    # --- the same again

    def test_default_scene_takes_a_step_bias(self, scheme):
        run = self.run(scheme, dat21(0.3), impacts=4, step_bias=True, times=[1.0])
        assert np.isfinite(
            run.step_bias[["bias", "se_bias", "corrected", "se_corrected", "rest"]].to_numpy()
        ).all()
        assert np.isfinite(run.at_times()[["coarse_rho1", "coarse_rho2"]].to_numpy()).all()
