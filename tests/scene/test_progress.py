"""What long work says: nothing while it is short, then what it does, how far it is, and how long the rest may take."""

import io
import sys
import threading

import pytest

from rattle.scene import progress
from rattle.scene.progress import ProgressBar, compiling, describe, do, print_on_stderr, speaking


class Log(io.StringIO):
    """Standard error of a pipe; an event for each line tells that it has been written."""

    def __init__(self):
        super().__init__()
        self.lines = 0
        self.more = threading.Condition()

    def write(self, text):
        with self.more:
            self.lines += text.count("\n")
            self.more.notify_all()
            return super().write(text)

    def wait_for(self, lines):
        with self.more:
            assert self.more.wait_for(lambda: self.lines >= lines, timeout=60.0)


class Terminal(Log):
    def isatty(self):
        return True


@pytest.fixture
def pipe(monkeypatch):
    """Standard error as a pipe, from the test on: pytest sets its own after the fixtures."""

    def use(stream):
        monkeypatch.setattr(sys, "stderr", stream)
        return stream

    return use


@pytest.fixture
def soon(monkeypatch):
    monkeypatch.setattr(progress, "FIRST", 0.01)
    monkeypatch.setattr(progress, "BETWEEN", 0.01)
    monkeypatch.setattr(progress, "TICK", 0.01)


def test_short_work_says_nothing(pipe):
    log = pipe(Log())
    with speaking("short"):
        pass
    assert log.getvalue() == ""


@pytest.mark.usefixtures("soon")
def test_long_work_in_a_pipe_says_line_after_line_what_it_does(pipe):
    log = pipe(Log())
    with speaking("first"):
        log.wait_for(2)
        do("second")
        log.wait_for(log.lines + 2)
    said = log.getvalue().splitlines()
    assert said[0].startswith("rattle: first: ")
    assert said[-1].startswith("rattle: second: ")
    after = log.lines
    threading.Event().wait(0.05)
    assert log.lines == after


@pytest.mark.usefixtures("soon")
def test_a_pipe_reads_how_far_a_bar_is_and_sees_no_bar(pipe):
    log = pipe(Log())
    with speaking("work"), ProgressBar(total=4, label="simulating", unit="path") as bar:
        bar.update(2)
        log.wait_for(log.lines + 2)
    assert "\r" not in log.getvalue()
    assert "rattle: simulating: " in log.getvalue()
    assert "of 4 paths, about" in log.getvalue()


@pytest.mark.usefixtures("soon")
def test_a_terminal_has_no_line_left_at_the_end(pipe):
    pipe(Terminal())
    with speaking("work without a bar"):
        while "work without a bar" not in sys.stderr.getvalue():
            threading.Event().wait(0.01)
    last = sys.stderr.getvalue().split("\r")[-1]
    assert last.strip() == ""


def test_a_bar_is_shown_on_a_terminal_and_without_a_label_nowhere(pipe):
    pipe(Terminal())
    for label, shown in ((None, False), ("orbits", True)):
        sys.stderr.truncate(0)
        for _ in ProgressBar(range(3), label=label):
            pass
        assert ("orbits" in sys.stderr.getvalue()) == shown


def test_a_loop_that_an_error_leaves_leaves_no_bar(pipe):
    pipe(Log())

    def fail():
        for _ in ProgressBar(range(3), label="loop"):
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError), speaking("work"):
        fail()
    assert "loop" not in describe()


def test_compiling_is_said_before_all_else():
    with ProgressBar(range(3), label="loop"), compiling():
        assert "compiling" in describe()
    assert "compiling" not in describe()


@pytest.mark.parametrize("stream", [None, "closed"])
@pytest.mark.usefixtures("soon")
def test_where_standard_error_is_missing_or_closed_work_goes_on(stream, pipe):
    closed = Log()
    closed.close()
    pipe(closed if stream else None)
    print_on_stderr("nobody reads this")
    with speaking("work"):
        threading.Event().wait(0.05)
        assert list(ProgressBar(range(2), label="loop")) == [0, 1]
