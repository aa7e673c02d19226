"""Negative controls of the watched process and of the checks: hangs, deaths and wrong numbers are detected."""

from dataclasses import replace

import fuzz_bad_input
import fuzz_checks
import fuzz_sampled
import numpy as np
import pytest
from fuzz_control_jobs import ends_as_named
from fuzz_plan import SIMPLE
from fuzz_watched import Watched

from rattle.compare.study import store
from rattle.montecarlo.ensemble.result import Ensemble


def test_the_watch_tells_hangs_deaths_and_warnings_and_goes_on():
    watched = Watched(ends_as_named, {"waits": 0.4, "loops": 1.0}, [])
    found = {kind: watched.run(kind) for kind in ("waits", "fine", "loops", "dies", "warns", "well")}
    watched.close()
    assert {kind: o.ended for kind, o in found.items()} == {
        "waits": "hung", "fine": "complete", "loops": "hung", "dies": "died", "warns": "broken", "well": "complete",
    }  # fmt: skip
    assert "RuntimeWarning" in found["warns"].detail
    assert [kind for kind, o in found.items() if o.defect] == ["waits", "loops", "dies", "warns"]


def backwards(orbit):
    orbit.tau[1:] = orbit.tau[:0:-1].copy()
    return orbit


def lost(orbit):
    orbit.tau[2] = np.nan
    return orbit


def outside(orbit):
    orbit.before[1, 0] *= 1.5
    return orbit


@pytest.mark.parametrize("wrong", [backwards, lost, outside])
def test_a_wrong_orbit_is_seen(wrong, monkeypatch):
    right = fuzz_checks.follow
    assert fuzz_checks.check("orbit", SIMPLE, {"impacts": 3}) == ("complete", "")
    monkeypatch.setattr(fuzz_checks, "follow", lambda *given: wrong(right(*given)))
    with pytest.raises(AssertionError):
        fuzz_checks.check("orbit", SIMPLE, {"impacts": 3})


@pytest.mark.parametrize("table", ["covariance", "sd", "tau"])
def test_a_wrong_closure_is_seen(table, monkeypatch):
    right = fuzz_checks.mean_map

    def wrong(*given, **settings):
        m = right(*given, **settings)
        values = getattr(m.trace, table).copy()
        values[2] = -np.abs(values[2]) if table != "tau" else np.nan
        return replace(m, trace=replace(m.trace, **{table: values}))

    assert fuzz_checks.check("saltation", SIMPLE, {"impacts": 3}) == ("complete", "")
    monkeypatch.setattr(fuzz_checks, "mean_map", wrong)
    with pytest.raises(AssertionError):
        fuzz_checks.check("saltation", SIMPLE, {"impacts": 3})


@pytest.mark.parametrize(("column", "value"), [("agreement", 1.1), ("sd_tau", np.nan), ("rho1", 1.01), ("y1", np.inf)])
def test_a_wrong_simulation_is_seen(column, value, monkeypatch):
    settings = {"paths": 8, "impacts": 2, "dt": 0.01}
    assert fuzz_checks.check("exact-flight", SIMPLE, settings) == ("complete", "")
    right = Ensemble.columns.func
    monkeypatch.setattr(Ensemble, "columns", property(lambda run: right(run) | {column: np.array([value, value])}))
    with pytest.raises(AssertionError):
        fuzz_checks.check("exact-flight", SIMPLE, settings)


def test_workers_that_differ_are_seen(monkeypatch):
    right = fuzz_sampled.simulate
    settings = {"paths": 1030, "impacts": 1, "dt": 0.01}
    assert fuzz_checks.check("exact-flight", SIMPLE, settings) == ("complete", "")

    def wrong(*given, workers=1, **chosen):
        return right(*given, workers=workers, **(chosen | {"rng": workers}))

    monkeypatch.setattr(fuzz_sampled, "simulate", wrong)
    with pytest.raises(AssertionError, match="workers change"):
        fuzz_checks.check("exact-flight", SIMPLE, settings)


@pytest.mark.slow
def test_a_changed_number_in_a_cell_is_seen_where_there_is_no_seal(monkeypatch):
    """A changed footer renumbers the impacts in silence; where in the file that is differs from run to run."""

    def ends(flips):
        return {fuzz_bad_input.file("cell", [("flip", share, 0)])[0] for share in np.linspace(0.75, 0.999, flips)}

    assert ends(60) <= {"refused", "complete"}
    monkeypatch.setattr(store.Store, "read", blind)
    with pytest.raises(AssertionError):
        ends(5000)


def blind(self, cell):
    """A store that believes its files."""
    import json

    import pyarrow.parquet as pq

    try:
        found = pq.read_table(self.path(cell), use_threads=False, memory_map=False)
        facts = json.loads(found.schema.metadata[store.NAME])["facts"]
        return cell.restore(store.Content(found.to_pandas(), facts))
    except Exception:
        self._set_aside(self.path(cell), "damaged")
        return None


def test_an_error_without_the_name_of_its_field_is_seen():
    with pytest.raises(AssertionError, match="does not name"):
        fuzz_bad_input.refused(fuzz_bad_input.InputError("x", 1, "is bad"), "alpha")
