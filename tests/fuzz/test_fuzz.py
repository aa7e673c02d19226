"""More than a thousand scenes and bad inputs on every run, always the same; scenes of every magnitude, by every entry.

A watched process answers.
"""

import pytest
from fuzz_bad import commands, settings_of, spoilt_bytes, spoilt_scenes, spoilt_texts
from fuzz_bad_input import FILES, content
from fuzz_checks import ENTRIES, check
from fuzz_plan import BOUNDS, PLAN, examples, warm_up
from fuzz_watched import Watched
from fuzz_wide_plan import WIDE, job
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

pytestmark = pytest.mark.slow
SAME = settings(
    derandomize=True, database=None, deadline=None, phases=[Phase.generate], suppress_health_check=list(HealthCheck)
)
COUNT = {
    "scene": 150, "orbit": 150, "long orbit": 100, "published": 80, "corrected": 80, "saltation": 120, "branching": 20,
    "euler-maruyama": 100, "euler-maruyama-located": 100, "exact-flight": 120, "validate": 8,
}  # fmt: skip
WIDE_COUNT = {
    "scene": 30, "orbit": 40, "long orbit": 20, "published": 20, "corrected": 25, "saltation": 30, "branching": 8,
    "euler-maruyama": 30, "euler-maruyama-located": 30, "exact-flight": 40, "accuracy": 6, "validate": 5,
    "simulate a file": 10, "validate a file": 1, "study a file": 1,
}  # fmt: skip
TEXTS = ("scene", "study", "manifest", "page", "baseline")


@pytest.fixture(scope="module")
def watched():
    process = Watched(check, BOUNDS, [*warm_up(*PLAN), ("text", "page", "")])
    yield process
    process.close()


def answer(watched, *job):
    found = watched.run(*job)
    assert not found.defect, f"{found.ended} after {found.seconds:.1f} s: check{job!r}\n{found.detail}"
    return found


def test_a_thousand_scenes_and_every_entry_point():
    assert set(COUNT) == set(PLAN)
    assert set(WIDE_COUNT) == set(WIDE) == set(ENTRIES)
    assert sum(COUNT.values()) >= 1000


@pytest.mark.parametrize("entry", COUNT)
def test_a_scene_is_answered_stopped_with_a_reason_or_refused_by_name(entry, watched):
    ended = []

    @settings(SAME, max_examples=COUNT[entry])
    @given(examples(entry))
    def tried(example):
        ended.append(answer(watched, entry, *example).ended)

    tried()
    assert ended.count("complete") > 0.1 * len(ended)  # the space is not one that is refused throughout


@pytest.mark.parametrize("entry", WIDE_COUNT)
def test_a_scene_of_any_magnitude_is_answered_stopped_with_a_reason_or_refused_by_name(entry, watched):
    ended = [answer(watched, *job(0, number, entry)).ended for number in range(WIDE_COUNT[entry])]
    assert ended.count("refused") < 0.6 * len(ended)


def test_bad_scenes_are_refused_by_name(watched):
    @settings(SAME, max_examples=200)
    @given(spoilt_scenes())
    def tried(example):
        answer(watched, "spoilt scene", *example)

    tried()


def test_bad_settings_are_refused_by_name(watched):
    @settings(SAME, max_examples=120)
    @given(settings_of)
    def tried(example):
        answer(watched, "setting", *example)

    tried()


@pytest.mark.parametrize("kind", TEXTS)
def test_spoilt_texts_are_refused(kind, watched):
    written = content(kind)

    @settings(SAME, max_examples=30)
    @given(spoilt_texts(written))
    def tried(text):
        answer(watched, "text", kind, text)

    tried()


@pytest.mark.parametrize("kind", FILES)
def test_spoilt_files_are_refused_or_read_as_written(kind, watched):
    @settings(SAME, max_examples=40)
    @given(spoilt_bytes())
    def tried(how):
        answer(watched, "file", kind, how)

    tried()


def test_odd_commands_end_with_a_reason(watched):
    @settings(SAME, max_examples=50)
    @given(commands())
    def tried(words):
        answer(watched, "command", words)

    tried()


def test_a_text_may_be_long_and_odd(watched):
    for text in ("", "\x00", "=" * 10_000, "[" * 100_000, "a = " + "[" * 5000):
        for kind in TEXTS:
            answer(watched, "text", kind, text)


@settings(SAME, max_examples=20)
@given(st.text())
def test_no_text_is_a_scene(text):
    assert check("text", "scene", text)[0] == "refused"
