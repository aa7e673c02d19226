"""What the sessions within a session share."""

import re

import numba
import pytest
from scenes import dat21
from scipy.special import ndtri

from rattle.closure import mean_map
from rattle.compare.thresholds import messages  # noqa: F401
from rattle.montecarlo import Record, Sampling, simulate

HEAD = """
import pytest
from rattle.closure import mean_map
from rattle.scene import DAT21, Scene
"""
"""What each suite begins with."""


@pytest.fixture(scope="session", autouse=True)
def loaded():
    """An inner session forgets the modules that it has loaded itself, and numba's can be loaded
    only once."""
    # loads what only compiling needs, though all else comes from numba's cache
    numba.njit(lambda: 0)()
    scene = dat21(0.02)
    mean_map(scene, impacts=1, closure="branching")
    record = Record(batches=True, energy=True)
    simulate(scene, paths=2, impacts=1, sampling=Sampling(control=True), record=record)


@pytest.fixture(autouse=True)
def alone(monkeypatch):
    """Inner sessions load no slow plugin of others, and print as on a terminal: pytest cuts no line
    in a CI."""
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    monkeypatch.setenv("COLUMNS", "80")
    for name in ("CI", "BUILD_NUMBER"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture(scope="session")
def ensembles(tmp_path_factory):
    return tmp_path_factory.mktemp("ensembles")


@pytest.fixture
def run(pytester, ensembles):
    """Pytest on a suite, with ensembles that the tests of this folder share."""

    def running(suite, *options, cache=ensembles):
        pytester.makepyfile(test_suite=HEAD + suite)
        kept = [] if cache is None else [f"--rattle-cache={cache}"]
        return pytester.runpytest_inprocess(
            "-p", "rattle.compare.thresholds.plugin", *kept, *options
        )

    return running


@pytest.fixture
def run_workers(pytester, ensembles):
    """The same on two workers of xdist, each a process of its own."""

    def running(suite, *options):
        pytester.makepyfile(test_suite=HEAD + suite)
        plugins = ("-p", "rattle.compare.thresholds.plugin", "-p", "xdist", "-n2")
        return pytester.runpytest_subprocess(*plugins, f"--rattle-cache={ensembles}", *options)

    return running


@pytest.fixture(scope="session")
def said():
    """What the output of a session says where a pattern has its group."""

    def saying(result, pattern):
        found = re.search(pattern, result.stdout.str())
        assert found, result.stdout.str()
        return found.group(1)

    return saying


@pytest.fixture(scope="session")
def width():
    """Half width of the intervals of so many rows at so many looks, as a session prints it: in
    standard errors, normal, for a false alarm in one of a hundred tests (Bonferroni)."""
    return lambda rows, looks=1: f"{-ndtri(0.005 / (rows * looks)):.2f}"
