"""A wrong marker is an error of its own test and of no other; a wrong option one of the session."""

import re
from pathlib import Path

import pytest

DAT21 = Path(__file__).resolve().parent / "example_suite/dat21.toml"
GOOD_TEST = """
S = Scene.from_gears(DAT21, sigma=0.02)

@pytest.mark.rattle(scene=S, impacts=1, paths=2048)
def test_good(rattle):
    rattle.check("saltation")

def test_other():
    pass

"""

BAD_MARKERS = {
    "scene='nowhere.toml'": "scene = 'nowhere.toml': there is no file",
    "scene='.'": "scene = '.': there is no file",
    "scene='impossible.toml'": "impossible.toml, line 4: gears.epsilon = 1.9: must lie",
    "scene='damaged.toml'": "scene = 'damaged.toml': is not a scene (",
    "": "scene = None: give a Scene",
    "scene=S, quantities=['y1', 'speed']": "quantities = 'speed': valid are 'tau'",
    "scene=S, moments='skew'": "moments = 'skew': valid are 'mean', 'sd'",
    "scene=S, impact=3": (
        "option of the marker rattle = 'impact': unknown key; did you mean 'impacts'?"
    ),
    "scene=S, impacts=[0, 1]": "impacts = 0: must be at least 1",
    "scene=S, within=-0.1": "within of the mean = -0.1: must be greater than 0",
    "scene=S, within={'mean': 0.1}": "within = {'mean': 0.1}: give 'sd' a tolerance too",
    "scene=S, within=0.1, absolute=0.1": (
        "absolute = 0.1: within has a tolerance for the mean already"
    ),
    "scene=S, paths=2": "paths = 2: must be at least 1024",
    "scene=S, paths=4096, accuracy=0.1": (
        "accuracy = 0.1: chooses the number of paths itself; leave out paths = 4096"
    ),
    "scene=S, budget=4096, accuracy=0.1": (
        "accuracy = 0.1: chooses the number of paths itself; leave out budget = 4096"
    ),
    "scene=S, budget=0": "budget = 0: must be at least 1",
    "scene=S, undecided='pass'": "undecided = 'pass': valid are 'fail', 'skip'",
    "scene=S, scheme='euler'": "scheme = 'euler': valid are 'euler-maruyama', ",
    "'dat21.toml'": "marker rattle = ('dat21.toml',): name every option",
}


def marked(options, name="test_bad"):
    return f"\n@pytest.mark.rattle({options})\ndef {name}(rattle): pass\n"


def test_bad_markers_are_errors_of_their_own_tests(run, pytester, said, width):
    (pytester.path / "impossible.toml").write_text(
        DAT21.read_text().replace("epsilon = 0.9", "epsilon = 1.9")
    )
    (pytester.path / "damaged.toml").write_text("[scene\n")
    result = run(
        GOOD_TEST
        + "".join([marked(options, f"test_{i}") for i, options in enumerate(BAD_MARKERS)])
        + "\n@pytest.mark.rattle(scene=S)\ndef test_idle(): pass\n"
    )
    result.assert_outcomes(passed=2, errors=len(BAD_MARKERS) + 1)
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    sections = re.split(r"_+ ERROR at setup of (\w+) _+\n", result.stdout.str())
    shown = dict(zip(sections[1::2], sections[2::2], strict=True))
    for i, message in enumerate(BAD_MARKERS.values()):
        assert message in shown[f"test_{i}"]
    assert "its marker has no effect; let the test take the fixture 'rattle'" in shown["test_idle"]
    # as if the others were not there
    assert said(result, r"intervals  (\S+) standard errors, ") == width(6, 4)


def test_a_bad_marker_that_is_not_selected_is_not_read(run):
    run(GOOD_TEST + marked("scene=S, within=0.0"), "-k", "good").assert_outcomes(
        passed=1, deselected=2
    )


def test_collecting_alone_says_what_could_not_be_read(run):
    result = run(GOOD_TEST + marked("scene=S, within=0.0"), "--collect-only", "-q")
    assert result.ret == pytest.ExitCode.OK
    result.stdout.fnmatch_lines(
        [
            "rattle: test_suite.py::test_bad: within of the mean = 0.0: must be *",
            "test_suite.py::test_good",
        ]
    )


BAD_OPTIONS = {
    "rattle-false-alarm=2": "rattle-false-alarm = 2.0: must lie between 0 and 1",
    "rattle-false-alarm=few": "rattle-false-alarm = 'few': give a number",
    "rattle-seed=-1": "rattle-seed = -1: must be at least 0",
    "rattle-workers=1.5": "rattle-workers = '1.5': give a whole number",
    "rattle-budget=0": "rattle-budget = 0: must be at least 1",
    "rattle-budget=1e6": "rattle-budget = '1e6': give a whole number",
}


@pytest.mark.parametrize("option", BAD_OPTIONS)
def test_bad_options_end_the_session(run, option):
    result = run(GOOD_TEST, f"--{option}", "--collect-only")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    assert BAD_OPTIONS[option] in result.stderr.str()


def test_a_bad_option_in_the_configuration_file_ends_the_session(run, pytester):
    pytester.makeini("[pytest]\nrattle_budget = 1e6\n")
    assert "rattle-budget = '1e6': give a whole number" in run(GOOD_TEST).stderr.str()
