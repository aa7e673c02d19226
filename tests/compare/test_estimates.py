"""What long work is expected to take is said before it begins, where a bar is asked for, and is
counted."""

import logging
import re
from functools import partial

import pytest
from scenes import dat21

from rattle import boundary, boundary_map, crossing, sensitivity, stationary
from rattle.compare import closure_sensitivity
from rattle.montecarlo.long_run import expect_run, long_run

ESTIMATED = dat21(0.5)
FAINT = dat21(0.01)
TIME = r"about [\d.]+ (ms|s|minutes|h)"
FEW = {"points": 2, "width": 0.9}
SEARCH = {"between": (0.01, 0.1), **FEW}
ASKED = {
    "stationary": (
        partial(stationary, ESTIMATED, periods=64, paths=16, budget=1e-3),
        rf"^x: 88 periods of 16 paths at the least, {TIME} of processor time, more than the budget"
        r" of 1 ms$",
    ),
    "sensitivity": (
        partial(sensitivity, ESTIMATED, quantities=["power"], parameters=["omega"], accuracy=1.0),
        rf"^x: 5 motions of 32 paths each, {TIME} of processor time at the least, 60 s at the"
        " most$",
    ),
    "closure": (
        partial(
            closure_sensitivity, FAINT, parameters=["omega"], impacts=1, paths=1024, budget=1e-3
        ),
        rf"^x: 80 runs of 64 paths, {TIME} of processor time$",
    ),
    "boundary": (
        partial(boundary, FAINT, impacts=1, **SEARCH),
        rf"^x: 2 values of sigma, .* {TIME} to [\d.]+ (ms|s) of processor time$",
    ),
    "map": (
        partial(boundary_map, FAINT, along="alpha", values=2, impacts=1, **SEARCH),
        rf"^boundary: 4 values of sigma, .* {TIME} to [\d.]+ (ms|s) of processor time$",
    ),
    "crossing": (
        partial(
            crossing, ESTIMATED, quantity="power", level=1e6, over="amplitude", **FEW, budget=1e-3
        ),
        rf"^x: 2 values of amplitude, .* {TIME} to [\d.]+ (ms|s) of processor time$",
    ),
}


class Stopped(Exception):
    """Raised in place of the work."""


@pytest.mark.parametrize("name", ASKED)
def test_an_estimate_is_said_before_the_work_where_a_bar_is_asked_for(name, caplog, monkeypatch):
    """The first bar comes after it: what is said then is all that was done."""

    def stop(*_, **__):
        raise Stopped

    work, said = ASKED[name]
    label = True if name == "map" else "x"
    for module in (
        "montecarlo.long_run.run",
        "compare.engine.run",
        "compare.parameters.boundary",
        "compare.parameters.crossing",
        "compare.parameters.of_closure",
        "compare.parameters.sensitivity",
    ):
        monkeypatch.setattr(f"rattle.{module}.ProgressBar", stop)
    caplog.set_level(logging.INFO, "rattle.estimate")
    with pytest.raises(Stopped):
        work()
    assert not caplog.records
    with pytest.raises(Stopped):
        work(progress=label)
    (message,) = caplog.messages
    assert re.search(said, message)


def test_the_periods_of_an_estimate_are_those_of_the_run():
    """To the pilot run's, which end with a number of impacts."""
    expected = expect_run(ESTIMATED, 64, periods=64, burn_in=32)
    found = long_run(ESTIMATED, paths=64, periods=64, burn_in=32, rng=3)
    assert expected.periods == pytest.approx(found.burn_in.periods + found.periods, rel=0.1)
