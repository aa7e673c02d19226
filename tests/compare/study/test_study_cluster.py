"""The same cells on a real Dask cluster of several processes."""

import os
import shutil
import signal
import socket
import subprocess
import threading
import time
from contextlib import ExitStack
from pathlib import Path

import pandas as pd
import processes
import pytest
from commands import rattle
from programs import python
from refusals import refusal
from studies import (
    CELLS_FOLDER,
    Deadly,
    Refused,
    Signalled,
    Store,
    compute,
    run,
    study_text,
    tables_of,
)

from rattle import Study
from rattle.compare.engine import cluster as module
from rattle.compare.engine.cluster import Cluster, Lost
from rattle.montecarlo.kernel.block import BLOCK

distributed = pytest.importorskip("distributed", reason="needs the extra cluster")
dask = pytest.importorskip("dask")

# Dask's, as workers are killed, loops closed
pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore"),
]


def scheduler_here(protocol="tcp://", security=None):
    """A scheduler in this process, without workers."""
    return distributed.LocalCluster(
        n_workers=0,
        protocol=protocol,
        security=security,
        dashboard_address=":0",
        silence_logs=50,
    )


@pytest.fixture(scope="module")
def cluster():
    with scheduler_here() as running:
        yield running


@pytest.fixture(scope="module")
def pool(cluster):
    """Two workers of one thread each, as processes; new ones take the place of those that the
    tests before have lost."""
    with ExitStack() as stack:

        def fill():
            while len(cluster.scheduler.workers) < 2:
                stack.enter_context(processes.worker(cluster.scheduler_address))
            return cluster.scheduler_address

        yield fill


@pytest.fixture
def place(pool, monkeypatch):
    """The cluster with its two workers; ensembles of more than four blocks are several tasks."""
    monkeypatch.setattr(Cluster, "share", 4)
    return Cluster(pool(), patience=60.0)


@pytest.fixture(scope="module")
def study():
    """Ensembles of two tasks each."""
    return Study.from_toml(study_text(sigmas=(0.02, 0.1), paths=5 * BLOCK + 77))


@pytest.fixture(scope="module")
def local(study, tmp_path_factory):
    return compute(study, tmp_path_factory.mktemp("local"), workers=2)


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / CELLS_FOLDER)


@pytest.mark.parametrize("lost", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "suspended"])
def test_results_equal_the_local_ones_though_a_worker_is_lost_at_work(
    lost, place, study, local, store, tmp_path, monkeypatch, capsys
):
    """What it was computing, and what it holds, is computed by the other worker; a suspended one is
    named."""
    monkeypatch.setattr(module, "SILENCE", 5.0)
    first, cell, *others = study.cells
    fatal = Signalled(
        cell.scene, cell.impacts, cell.closure, first=str(tmp_path / "f"), signal=lost
    )
    assert fatal.key == cell.key
    assert run([first, fatal, *others], store, place, show=True).computed == len(study.cells)
    there = tables_of(study, store)
    for name in ("errors", "sections", "paired"):
        pd.testing.assert_frame_equal(getattr(there, name), getattr(local, name), check_exact=True)
    assert Path(fatal.first).exists()
    assert capsys.readouterr().err.count(
        "has not answered for 5 s; its cells go to the others"
    ) == (lost == signal.SIGSTOP)


def test_a_worker_of_another_version_is_refused(place, study, store, monkeypatch):
    monkeypatch.setattr(module, "numerical_version", _another)
    with pytest.raises(
        Lost, match=r"has numerical version .*, here it is version of .*: install the same there"
    ):
        run(study.cells, store, place)


def _another(*packages):
    return f"version of process {os.getpid()}"


def test_a_cluster_without_workers_is_named(study, store):
    with scheduler_here() as empty, refusal("has no workers"):
        run(study.cells, store, Cluster(empty.scheduler_address, patience=1.0))


@pytest.fixture
def small():
    return Study.from_toml(study_text(sigmas=(0.02, 0.1)))


PATIENT = (
    "from rattle.compare.engine.cluster import Cluster; Cluster.__init__.__defaults__ = (120.0,);"
    "from rattle.compare.cli.main import main; main()"
)
"""The command, on a machine that may have much else to do."""


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


def test_a_lost_scheduler_ends_the_study_with_one_line(tmp_path):
    """A command that is interrupted; the same command continues, here or on the cluster."""
    file = tmp_path / "s.toml"
    file.write_text(study_text(sigmas=(0.02, 0.05, 0.1), paths=100_000))
    store = Store(tmp_path / "s" / CELLS_FOLDER)
    with processes.scheduler() as (scheduler, address), processes.worker(address):
        killer = meanwhile(store, 2, scheduler.kill)
        done = python("-c", PATIENT, "study", file, "--scheduler", address, code=2)
        killer.join()
    lines = [text for text in done.stderr.splitlines() if not text.startswith("rattle: study")]
    (line,) = lines  # besides those that say how far it is
    lost = "no longer answers: start it again; finished results"
    assert line.startswith(f"rattle: scheduler = {address!r}: {lost}")
    assert 2 <= len([cell for cell in Study.load(file).cells if store.read(cell)]) < 9


def test_cells_that_cannot_be_computed_cost_themselves_only(
    small, store, cluster, place, monkeypatch
):
    """One that kills its worker, and one that is refused there: the reasons are given, all others
    are computed."""
    monkeypatch.setattr(cluster.scheduler, "allowed_failures", 0)
    one, two, *_ = (cell for cell in small.cells if hasattr(cell, "closure"))
    deadly = Deadly(one.scene, one.impacts, one.closure)
    refused = Refused(two.scene, two.impacts, two.closure)
    others = [cell for cell in small.cells if cell.key not in (deadly.key, refused.key)]
    failed = run([deadly, refused, *others], store, place).failed
    assert failed.keys() == {deadly.key, refused.key}
    assert "the workers that computed it died (1 of them" in failed[deadly.key]
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
    """It accepts connections and is silent."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        address = f"tcp://127.0.0.1:{listening.getsockname()[1]}"
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
    tls = {f"{who}.cert": "cert" for who in ("client", "scheduler", "worker")}
    tls |= {name.replace("cert", "key"): "key" for name in tls}
    tls["ca-file"] = "cert"
    return {f"distributed.comm.tls.{name}": str(at / what) for name, what in tls.items()}


def test_a_study_over_tls(small, store, certificates):
    """With certificates in Dask's configuration; without them it is said what is missing."""
    settings = {**certificates, "distributed.comm.require-encryption": "true"}
    with dask.config.set(settings):
        inherited = dask.config.serialize(dask.config.global_config)
        security = distributed.Security()
        with scheduler_here(protocol="tls://", security=security) as running:
            address = running.scheduler_address
            assert address.startswith("tls://")
            with processes.worker(address, DASK_INTERNAL_INHERIT_CONFIG=inherited):
                outcome = run(small.cells, store, Cluster(address, patience=60.0))
    assert outcome.computed == len(small.cells)
    with refusal("needs certificates; name them in Dask's configur"):
        Cluster(address).__enter__()
