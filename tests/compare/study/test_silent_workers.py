"""Workers of a cluster that do not answer, as the scheduler's heartbeats tell it; a real one:
test_study_cluster."""

from types import SimpleNamespace

import pytest

from rattle.compare.engine import cluster as module
from rattle.compare.engine.cluster import SILENCE, Cluster, Lost, remove_worker


class Scheduler:
    """What a client asks of it; the clock is that of the workers and of this program."""

    def __init__(self, workers):
        self.now = 0.0
        self.suspended = {}
        self.removed = []
        self.workers = set(workers)
        self.scheduler = self
        self.identity = "identity"

    def sync(self, asked, callback_timeout):
        assert asked == "identity"
        seen = {
            worker: {"last_seen": self.suspended.get(worker, self.now)} for worker in self.workers
        }
        return {"workers": seen}

    def run_on_scheduler(self, function, worker):
        assert function is remove_worker
        self.workers.discard(worker)
        self.removed.append(worker)


@pytest.fixture
def watch(monkeypatch):
    """A cluster of two workers, and what it says while some seconds pass."""
    place = Cluster("tcp://127.0.0.1:8786")
    client = Scheduler("ab")
    place._client = client
    place._seen = 0.0
    place._looked = 0.0
    place._heartbeats = {}
    place._all_silent = False
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: client.now))

    def pass_time(seconds):
        said = []
        for _ in range(int(seconds / 0.5)):
            client.now += 0.5
            place.check(said.append)
        return said

    return client, pass_time


def test_a_silent_worker_is_named_once_and_removed(watch):
    client, pass_time = watch
    assert pass_time(100.0) == []
    client.suspended["a"] = client.now
    assert pass_time(SILENCE - 2.0) == []
    assert pass_time(30.0) == ["worker a has not answered for 20 s; its cells go to the others"]
    assert client.removed == ["a"]


def test_nobody_is_removed_while_no_other_answers(watch):
    """It is said once, and again after one of them has answered."""
    client, pass_time = watch
    for _ in range(2):
        client.suspended |= dict.fromkeys("ab", client.now)
        (said,) = pass_time(100.0)
        assert said.startswith("no worker has answered for 20 s (")
        client.suspended.clear()
        assert pass_time(5.0) == []
    assert client.removed == []


def test_a_new_worker_takes_the_place_of_silent_ones(watch):
    client, pass_time = watch
    client.suspended |= dict.fromkeys("ab", client.now)
    pass_time(60.0)
    client.workers.add("c")
    assert len(pass_time(3.0)) == 2
    assert client.workers == {"c"}


def test_a_cluster_without_workers_is_lost(watch):
    client, pass_time = watch
    client.workers.clear()
    with pytest.raises(Lost, match="has had no workers for 15 s"):
        pass_time(60.0)
