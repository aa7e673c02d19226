"""What long work says of itself: order and content, never how long it took."""

import io
import re
import sys
import threading

import pytest
from programs import on_terminal, python, start

from rattle.scene import progress
from rattle.scene.progress import ProgressBar, do, speaking

AT_ONCE = (
    "from rattle.scene import progress;"
    " progress.QUIET = progress.BETWEEN = progress.LINE_TICK = 0.005\n"
)
RUN = AT_ONCE + "from rattle.compare.cli.main import main; main({words})"
HOLDING = """
import sys
from rattle.compare.cli.main import main
from rattle.scene.progress import ProgressBar

@main.command()
def hold():
    "Wait for a word."
    with ProgressBar(label="holding", total=4, unit="stone") as bar:
        sys.stdin.readline()
        bar.update()
        sys.stdin.readline()
    print("answer")

main(["hold"])
"""
COMPILE = """
import sys
import numba
import rattle.scene.compiled
__name__ = "{package}.module"
from rattle.scene.progress import speaking

@numba.njit
def twice(x):
    return 2 * x

{how}
print("answer")
"""


def test_a_command_says_what_it_does_before_it_answers():
    """A pipe is read while it runs: it is told to go on only after it has said where it is."""
    with start("-c", AT_ONCE + HOLDING) as held:
        seen = [held.stderr.readline()]
        while "holding: 0 of 4 stones" not in seen[-1]:
            seen.append(held.stderr.readline())
        held.stdin.write("\n")
        while "holding: 1 of 4 stones" not in seen[-1]:
            seen.append(held.stderr.readline())
        said, _ = held.communicate("\n")
    assert re.search(r"rattle: holding: 1 of 4 stones, about [\d.]+ (ms|s|minutes) left$", seen[-1])
    assert said == "answer\n"


def test_no_bar_is_left_where_an_answer_is_printed_on_a_terminal():
    words = ["simulate", "--sigma", "0.1", "--paths", "100_000", "--impacts", "4"]
    written, seen = on_terminal("-c", RUN.format(words=words))
    assert "simulate (Simulate a scene" in written
    assert "simulating: " in written
    bars = [line for line in seen if "|" in line]
    assert len(bars) == 1
    assert bars[0].startswith("simulating: 100%")
    (head,) = [line for line in seen if "se_tau" in line]
    assert head.startswith("impact")
    assert not [line for line in seen if "so far" in line]


def test_compiling_is_said_by_a_command_in_a_pipe():
    done = python(
        "-c", AT_ONCE + COMPILE.format(package="rattle", how="with speaking('nothing'): twice(1)")
    )
    assert "rattle: compiling for this processor, once" in done.stderr
    assert done.stdout == "answer\n"


def test_a_program_in_a_pipe_compiles_silently():
    done = python("-c", AT_ONCE + COMPILE.format(package="rattle", how="twice(1)"))
    assert (done.stdout, done.stderr) == ("answer\n", "")


def test_a_program_on_a_terminal_shows_that_it_compiles_and_takes_it_away():
    written, seen = on_terminal("-c", AT_ONCE + COMPILE.format(package="rattle", how="twice(1)"))
    assert "compiling for this processor, once" in written
    assert [line for line in seen if line] == ["answer"]


FORKED = """
import multiprocessing
p = multiprocessing.get_context("fork").Process(target=twice, args=(1,))
p.start()
p.join()
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("package", "how", "environment"),
    [
        ("rattle", FORKED, {}),
        ("rattle", "twice(1)", {"PYTEST_CURRENT_TEST": "a test"}),
        ("mine", "twice(1)", {}),
    ],
)
def test_workers_and_tests_on_a_terminal_compile_silently_and_so_do_users_functions(
    package, how, environment
):
    code = AT_ONCE + COMPILE.format(package=package, how=how)
    written, _ = on_terminal("-c", code, **environment)
    assert written.strip() == "answer"


def test_a_forked_process_does_not_wait_for_a_thread_of_its_parent():
    code = """
import os, threading
from rattle.scene import progress

held, end = threading.Event(), threading.Event()

def hold():
    with progress._lock:
        held.set()
        end.wait()

threading.Thread(target=hold, daemon=True).start()
held.wait()
if (child := os.fork()) == 0:
    progress.ProgressBar(label="in the child", total=1).close()
    os._exit(0)
print(os.waitpid(child, 0)[1])
end.set()
"""
    assert python("-c", code).stdout == "0\n"


@pytest.fixture
def words(monkeypatch):
    """Lines that are said at once, as they are said; what is waited for is the thread's, not a
    time."""
    said = []
    heard = threading.Condition()

    def say(text):
        with heard:
            said.append(text)
            heard.notify_all()

    def wait(text):
        with heard:
            assert heard.wait_for(lambda: any(text in one for one in said), 120.0), said

    monkeypatch.setattr(progress, "QUIET", 0.001)
    monkeypatch.setattr(progress, "BETWEEN", 0.001)
    monkeypatch.setattr(progress, "print_on_stderr", say)
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    return wait


def test_bars_within_bars_are_said_together_and_each_as_long_as_it_is_there(words):
    with speaking("all of it"):
        words("all of it: ")
        with ProgressBar(label="outer", total=3, unit="part") as outer:
            outer.set_postfix_str("sections")
            outer.update()
            with ProgressBar(label="inner", unit="value"):
                words("outer: 1 of 3 parts, about ")
                words(" left (sections); inner: 0 values")
        do("writing")
        words("writing: ")
    assert not progress._bars


def test_a_bar_that_an_error_leaves_is_closed():
    def leave():
        with speaking("all of it"):
            for i in ProgressBar([1, 0], label="loop"):
                1 / i

    with pytest.raises(ZeroDivisionError):
        leave()
    assert not progress._bars


def test_without_a_label_nothing_is_counted_or_said(capsys):
    bar = ProgressBar(range(3), unit="path")
    assert list(bar) == [0, 1, 2]
    assert not progress._bars
    assert capsys.readouterr() == ("", "")
