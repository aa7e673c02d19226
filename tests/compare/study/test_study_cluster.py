"""The same cells on a real Dask cluster of several processes."""

import os
import re
import shutil
import signal
import socket
import subprocess
import threading
import time
from contextlib import ExitStack, contextmanager

import pandas as pd
import processes
import pytest
from commands import rattle
from programs import python
from refusals import refusal
from studies import CELLS_FOLDER, Deadly, Refused, Store, compute, run, study_text, tables_of

from rattle import Study
from rattle.compare.engine import cluster as module
from rattle.compare.engine.cluster import BLOCKS_OF_A_TASK, Cluster, Lost

distributed = pytest.importorskip("distributed", reason="needs the extra cluster")
dask = pytest.importorskip("dask")

PROGRESS = "rattle: study"  # begins a line that says how far a command is

# Dask's, as workers are killed, loops closed
pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore"),
]


def local_cluster(workers):
    """Dask's own cluster on this machine, of processes."""
    settings = {"processes": True, "dashboard_address": ":0", "silence_logs": 50}
    return distributed.LocalCluster(n_workers=workers, threads_per_worker=1, **settings)


@pytest.fixture(scope="module")
def cluster():
    with local_cluster(2) as running:
        yield running


@pytest.fixture(scope="module")
def study():
    """Ensembles of two tasks each."""
    return Study.from_toml(study_text(sigmas=(0.02, 0.1), paths=(BLOCKS_OF_A_TASK + 5) * 1024 + 77))


@pytest.fixture(scope="module")
def local(study, tmp_path_factory):
    return compute(study, tmp_path_factory.mktemp("local"), workers=2)


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / CELLS_FOLDER)


def test_results_equal_the_local_ones_though_a_worker_is_killed(cluster, study, local, store):
    victim = next(iter(cluster.workers.values())).pid
    killer = threading.Timer(0.7, os.kill, (victim, signal.SIGKILL))
    killer.start()
    outcome = run(study.cells, store, Cluster(cluster.scheduler_address))
    killer.join()
    assert outcome.computed == len(study.cells)
    there = tables_of(study, store)
    for name in ("errors", "sections", "paired"):
        pd.testing.assert_frame_equal(getattr(there, name), getattr(local, name), check_exact=True)
    # it was killed, and another took its place
    assert victim not in [worker.pid for worker in cluster.workers.values()]


def test_a_worker_of_another_version_is_refused(cluster, study, store, monkeypatch):
    monkeypatch.setattr(module, "numerical_version", _another)
    said = r"has numerical version .*, here it is version of .*: install the same there"
    with pytest.raises(Lost, match=said):
        run(study.cells, store, Cluster(cluster.scheduler_address))


def _another(*packages):
    return f"version of process {os.getpid()}"


def test_a_cluster_without_workers_is_named(study, store):
    with local_cluster(0) as empty, refusal("has no workers"):
        run(study.cells, store, Cluster(empty.scheduler_address, patience=1.0))


@pytest.fixture
def small():
    return Study.from_toml(study_text(sigmas=(0.02, 0.1)))


PATIENT = (
    "from rattle.compare.engine.cluster import Cluster; Cluster.__init__.__defaults__ = (120.0,);"
    "from rattle.compare.cli.main import main; main()"
)
"""The command, on a machine that may have much else to do."""


@contextmanager
def of_our_own(workers, **environment):
    """A scheduler with workers of one thread each, as processes: its process and address, and
    theirs."""
    with ExitStack() as stack:
        running, address = stack.enter_context(processes.scheduler(**environment))
        processes_of_workers = [
            stack.enter_context(processes.worker(address))[0] for _ in range(workers)
        ]
        yield running, address, processes_of_workers


def meanwhile(store, cells, act):
    """Do something as soon as so many cells are stored."""

    def watch():
        end = time.monotonic() + 240.0
        while len(list(store.folder.glob("*.parquet"))) < cells and time.monotonic() < end:
            time.sleep(0.01)
        act()

    thread = threading.Thread(target=watch)
    thread.start()
    return thread


def kept(study, store):
    return [cell for cell in study.cells if store.read(cell)]


def test_a_lost_scheduler_ends_the_study_with_one_line(small, tmp_path):
    """A command that is interrupted; the same command continues, here or on the cluster."""
    file = tmp_path / "s.toml"
    file.write_text(study_text(sigmas=(0.02, 0.05, 0.1), paths=400_000))
    store = Store(tmp_path / "s" / CELLS_FOLDER)
    with of_our_own(1) as (scheduler, address, _):
        killer = meanwhile(store, 2, scheduler.kill)
        done = python("-c", PATIENT, "study", file, "--scheduler", address, code=2)
        killer.join()
    *progress, line = done.stderr.splitlines()
    assert all(earlier.startswith(PROGRESS) for earlier in progress), progress
    lost = "no longer answers: start it again; finished results"
    assert line.startswith(f"rattle: scheduler = {address!r}: {lost}")
    assert 2 <= len(kept(Study.load(file), store)) < 9


def test_a_suspended_worker_is_named_and_the_others_go_on(store, monkeypatch, capsys):
    """It is suspended at work: what it was computing, and what it holds, is computed by the other
    worker."""
    monkeypatch.setattr(module, "SILENCE", 5.0)
    wanted = Study.from_toml(study_text(sigmas=(0.02, 0.05, 0.1), paths=400_000))
    with of_our_own(2) as (_, address, workers):
        stopper = meanwhile(store, 1, lambda: workers[0].send_signal(signal.SIGSTOP))
        outcome = run(wanted.cells, store, Cluster(address, patience=60.0), show=True)
        stopper.join()
    assert outcome.computed == len(wanted.cells)
    silent = r"worker tcp://\S+ has not answered for 5 s; its cells go to the others"
    assert len(re.findall(silent, capsys.readouterr().err)) == 1


def test_cells_that_cannot_be_computed_cost_themselves_only(small, store):
    """One that kills its workers, and one that is refused there: the reasons are given, all others
    are computed."""
    predictions = [cell for cell in small.cells if hasattr(cell, "closure")]
    deadly, refused = (
        kind(cell.scene, cell.impacts, cell.closure)
        for kind, cell in zip((Deadly, Refused), predictions, strict=False)
    )
    others = [cell for cell in small.cells if cell.key not in (deadly.key, refused.key)]
    with of_our_own(2, DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES="0") as (_, address, _):
        place = Cluster(address, patience=60.0)
        failed = run([deadly, refused, *others], store, place).failed
    assert failed.keys() == {deadly.key, refused.key}
    assert re.search(r"the workers that computed it died \(1 of them", failed[deadly.key])
    assert "impacts = 2: are too many" in failed[refused.key]
    assert all(store.read(cell) for cell in others)


@pytest.mark.parametrize("address", ["ucx://127.0.0.1:8786", "tcp://127.0.0.1:0", "tcp://a b:1"])
def test_an_address_of_another_form_is_refused_before_anything_is_made(tmp_path, address):
    file = tmp_path / "s.toml"
    file.write_text(study_text())
    said = rattle(f"study {file} --scheduler", address, code=2).output
    assert f"scheduler = {address!r}: give tcp://HOST:PORT, or tls://HOST:PORT" in said
    assert not (tmp_path / "s").exists()


def test_a_server_that_is_no_scheduler_is_named(small, store):
    """One that accepts connections and is silent; one that is not there."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        for port in (listening.getsockname()[1], 9):
            address = f"tcp://127.0.0.1:{port}"
            with refusal(rf"{address}.* does not answer"):
                run(small.cells, store, Cluster(address, patience=1.0))


@pytest.fixture(scope="module")
def certificates(tmp_path_factory):
    """Dask's settings for a certificate that has signed itself."""
    if shutil.which("openssl") is None:
        pytest.skip("no openssl here: only with it can certificates be made")
    at = tmp_path_factory.mktemp("certificates")
    words = "openssl req -x509 -newkey rsa:2048 -nodes -keyout key -out cert -days 2 -subj /CN=ours"
    subprocess.run(words.split(), cwd=at, check=True, capture_output=True)
    own = {
        f"{who}.{what}": what
        for who in ("client", "scheduler", "worker")
        for what in ("cert", "key")
    }
    tls = own | {"ca-file": "cert"}
    return {f"distributed.comm.tls.{name}": str(at / what) for name, what in tls.items()}


def test_a_study_over_tls(small, store, certificates):
    """With certificates in Dask's configuration; without them it is said what is missing."""
    settings = {**certificates, "distributed.comm.require-encryption": "true"}
    environment = {
        f"DASK_{name.replace('.', '__').replace('-', '_').upper()}": v
        for name, v in settings.items()
    }
    with (
        processes.scheduler("tls://", **environment) as (_, address),
        processes.worker(address, **environment),
    ):
        assert address.startswith("tls://")
        with dask.config.set(certificates):
            outcome = run(small.cells, store, Cluster(address, patience=60.0))
        assert outcome.computed == len(small.cells)
        with refusal("needs certificates; name them in Dask's configur"):
            Cluster(address).__enter__()
