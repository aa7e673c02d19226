"""Workers of a cluster that do not answer, as the scheduler's heartbeats tell it; a real one:
test_study_cluster."""

from types import SimpleNamespace

import pytest

from rattle.compare.engine import cluster as module
from rattle.compare.engine.cluster import SILENCE, Cluster, Lost


class Scheduler:
    """What a client asks of it; the clock is that of the workers and of this program."""

    identity = "identity"

    def __init__(self):
        self.now = 0.0
        self.workers = dict.fromkeys("ab")  # since when they are suspended
        self.scheduler = self

    def sync(self, asked, callback_timeout):
        seen = {
            worker: {"last_seen": self.now if since is None else since}
            for worker, since in self.workers.items()
        }
        return {"workers": seen}

    def run_on_scheduler(self, function, worker):
        del self.workers[worker]


@pytest.fixture
def watch(monkeypatch):
    """A cluster of two workers, and what it says while some seconds pass."""
    place = Cluster("tcp://127.0.0.1:8786")
    client = Scheduler()
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
    client.workers["a"] = client.now
    assert pass_time(SILENCE - 2.0) == []
    assert pass_time(30.0) == ["worker a has not answered for 20 s; its cells go to the others"]
    assert [*client.workers] == ["b"]


def test_nobody_is_removed_while_no_other_answers(watch):
    """It is said once, and again after one of them has answered."""
    client, pass_time = watch
    for _ in range(2):
        client.workers = dict.fromkeys("ab", client.now)
        (said,) = pass_time(100.0)
        assert said.startswith("no worker has answered for 20 s (")
        assert [*client.workers] == ["a", "b"]
        client.workers = dict.fromkeys("ab")
        assert pass_time(5.0) == []


def test_a_new_worker_takes_the_place_of_silent_ones(watch):
    client, pass_time = watch
    client.workers = dict.fromkeys("ab", client.now)
    pass_time(60.0)
    client.workers["c"] = None
    assert len(pass_time(3.0)) == 2
    assert [*client.workers] == ["c"]


def test_a_cluster_without_workers_is_lost(watch):
    client, pass_time = watch
    client.workers.clear()
    with pytest.raises(Lost, match="has had no workers for 15 s"):
        pass_time(60.0)
