"""Limits of what is admitted, refused at the boundary by name, and what fuzzing has found at
them."""

from functools import partial

import pytest
from refusals import refusal
from scenes import dat21

from rattle import Sampling, Scene, Start, Tolerance, follow, mean_map, simulate

PLAIN_FIELDS = {"alpha": 1.5, "epsilon": 0.9, "beta1": 0.08, "gamma1": 0.06, "mu": 0.6}
LIMITS = {
    "alpha": ((0, 1e-30, 1e6), (1e-31, 1.1e6)),
    "beta1": ((0, 5e-324, 1e4), (1.1e4,)),
    "gamma2": ((0, 1e-30, 1e6), (1e-31, 1.1e6)),
    "sigma": ((0, 1e-30, 1e6), (1e-31, 1.1e6)),
    "epsilon": ((0, 5e-324, 1.0), (-1e-30, 1.1)),
    "mu": ((1e-30, 1.0 - 2.0**-53), (5e-324,)),
    "gap1": ((1e-9, 1e6), (9e-10, 1.1e6)),
    "start.y1": ((-1e6, 5e-324), (1.1e6,)),
    "start.tau": ((-1e12, 1e12, 5e-324), (1.1e12,)),
    "tolerance.c1_max": ((0.0, 0.01), (1e-300,)),
}
"""Values that a field takes, and values that it does not."""


@pytest.mark.parametrize("field", LIMITS)
def test_the_range_of_a_field(field):
    inside, beyond = LIMITS[field]
    owner, _, name = field.rpartition(".")
    make = {"start": Start, "tolerance": Tolerance, "": partial(Scene, **PLAIN_FIELDS)}[owner]
    for value in inside:
        assert getattr(make(**{name: value}), name) == value
    for value in beyond:
        with refusal(f"^{field} = "):
            make(**{name: value})


def test_clock_times_end_with_the_orbit_and_not_with_its_shifted_mean():
    m = mean_map(dat21(1e6), impacts=3)
    last = follow(m.scene, 3).tau[m.trace.found]
    assert len(m.at_times([0.5 * last])) == 1


@pytest.mark.parametrize("paths", [2, 3])
def test_a_control_of_few_paths_is_none(paths):
    """Three coefficients through three paths leave an error of 1e-10."""
    given = {"paths": paths, "impacts": 1, "dt": 0.01}
    controlled = simulate(dat21(0.1), sampling=Sampling(control=True), **given).section
    plain = simulate(dat21(0.1), **given).section
    assert controlled["se_y1"].to_list() == pytest.approx(plain["se_y1"].to_list(), rel=1e-12)
    assert controlled["se_y1"].loc[1] > 1e-4
