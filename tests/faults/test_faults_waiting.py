"""A process that waits for another one reports which, and continues when that one ends."""

import platform
import re
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from unittest.mock import Mock

import pytest
from commands import study
from programs import LONG, start
from studies import Runner, Store, run

from rattle import Study

WAITED_FOR = Study.from_toml(study(paths=1024)).cells
HOLD = """
import sys
from contextlib import ExitStack
from pathlib import Path
from rattle.compare.engine.store import Store

store = Store(Path(sys.argv[1]))
with ExitStack() as stack:
    print(all([stack.enter_context(store.alone(key)) for key in sys.argv[2:]]), flush=True)
    sys.stdin.read()
"""


@contextmanager
def locked_elsewhere(store, cells):
    """Context with another process that locks cells; yields its process id."""
    with start("-c", HOLD, store.folder, *(cell.key for cell in cells)) as other:
        assert other.stdout.readline() == "True\n"
        yield other.pid
        other.stdin.close()


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / "cells")


def test_a_study_whose_cells_are_in_other_hands_says_so_once(store, monkeypatch):
    """Also with more cells than threads."""
    heard = threading.Event()
    said = Mock(side_effect=lambda text: heard.set())
    monkeypatch.setattr("rattle.compare.engine.run.print_on_stderr", said)
    with ThreadPoolExecutor(1) as pool:
        with locked_elsewhere(store, WAITED_FOR) as number:
            waiting = pool.submit(run, WAITED_FOR, store, Runner(1), show=True)
            assert heard.wait(LONG)
            assert not waiting.done()
        assert waiting.result(LONG).computed == len(WAITED_FOR) == 2
    (text,) = said.call_args.args
    at = r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d"
    there = f"process {number} on {re.escape(platform.node())}"
    assert re.search(f"waiting for {there} since {at}, at work on .*; continues when it", text)
    assert said.call_count == 1
    assert text in (store.folder.parent / "study.log").read_text()


def test_under_pytest_it_is_said_while_the_test_runs(pytester):
    pytester.makepyfile("""
        from rattle.compare.thresholds.decision import _past_capture

        def test_it(request):
            _past_capture(request.config)("waiting for process 1")
    """)
    found = pytester.runpytest_subprocess()
    found.assert_outcomes(passed=1)
    found.stderr.fnmatch_lines(["rattle: waiting for process 1"])
