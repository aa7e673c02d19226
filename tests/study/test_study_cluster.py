"""The same cells on a real Dask cluster of several processes."""

import os
import signal
import threading
import time

import pandas as pd
import pytest
from study_files import study_text

from compare.study import places
from compare.study.design import Study
from compare.study.engine import run
from compare.study.places import Cluster, Here
from compare.study.results import Results
from compare.study.store import Store
from compare.study.tables import CELLS
from scene.errors import InputError

distributed = pytest.importorskip("distributed", reason="needs the extra cluster")

pytestmark = pytest.mark.filterwarnings("ignore")  # Dask's own, as workers are killed and loops are closed


@pytest.fixture(scope="module")
def cluster():
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as running:
        yield running


@pytest.fixture(scope="module")
def study():
    """Ensembles of three parts each."""
    return Study.from_toml(study_text(sigmas=(0.02, 0.1), paths=(2 * places.SHARE + 5) * 1024 + 77))


@pytest.fixture(scope="module")
def local(study, tmp_path_factory):
    store = Store(tmp_path_factory.mktemp("local") / CELLS)
    run(study, store, Here(2))
    return Results.of(study, store)


def test_results_equal_the_local_ones_to_the_last_bit(cluster, study, local, tmp_path):
    store = Store(tmp_path / CELLS)
    outcome = run(study, store, Cluster(cluster.scheduler_address))
    assert outcome.computed == len(study.cells)
    found = Results.of(study, store)
    pd.testing.assert_frame_equal(found.errors, local.errors, check_exact=True)
    pd.testing.assert_frame_equal(found.sections, local.sections, check_exact=True)
    pd.testing.assert_frame_equal(found.paired, local.paired, check_exact=True)


def test_a_killed_worker_costs_time_only(cluster, study, local, tmp_path):
    store = Store(tmp_path / CELLS)
    victim = next(iter(cluster.workers.values())).pid
    killer = threading.Timer(0.7, os.kill, (victim, signal.SIGKILL))
    killer.start()
    started = time.monotonic()
    run(study, store, Cluster(cluster.scheduler_address))
    assert time.monotonic() - started < 60.0
    killer.join()
    pd.testing.assert_frame_equal(Results.of(study, store).errors, local.errors, check_exact=True)
    assert victim not in {w.pid for w in cluster.workers.values() if w.pid}  # it was killed, and another took its place


def test_a_worker_of_another_version_is_refused(cluster, study, tmp_path, monkeypatch):
    monkeypatch.setattr(places, "numerical_version", _another)
    with pytest.raises(InputError, match=r"numerical version .*, here it is"):
        run(study, Store(tmp_path / CELLS), Cluster(cluster.scheduler_address))


def _another(*packages):
    return f"version of process {os.getpid()}"


def test_a_scheduler_that_does_not_answer_is_named(study, tmp_path):
    with pytest.raises(InputError, match="does not answer") as refused:
        run(study, Store(tmp_path / CELLS), Cluster("tcp://127.0.0.1:9", patience=1.0))
    assert "tcp://127.0.0.1:9" in str(refused.value)


def test_a_cluster_without_workers_is_named(study, tmp_path):
    with (
        distributed.LocalCluster(n_workers=0, processes=True, dashboard_address=None, silence_logs=50) as empty,
        pytest.raises(InputError, match="has no workers"),
    ):
        run(study, Store(tmp_path / CELLS), Cluster(empty.scheduler_address, patience=1.0))
