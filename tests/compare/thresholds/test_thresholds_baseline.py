"""Baselines: recorded on request, compared by default, regenerated where something changed and
never silently."""

import pytest

RECORDED_SUITE = """
SCENE = Scene.from_gears(DAT21, sigma=0.02)

@pytest.mark.rattle(scene=SCENE, impacts=2, quantities=["tau", "y1"], moments="mean")
@pytest.mark.parametrize("name", ["one", "a/b"])
def test_recorded(rattle, name):
    def model(scene, impacts):
        section = mean_map(scene, impacts=impacts).section
        section.loc[2, "y1"] += SHIFT
        return section
    rattle.baseline(model, relative=1e-6)
"""


@pytest.fixture
def recorded(run):
    def running(*options, shift=0.0, sigma=0.02):
        return run(
            RECORDED_SUITE.replace("SHIFT", str(shift)).replace("0.02", str(sigma)),
            *options,
            cache=None,
        )

    return running


def files(pytester):
    return {
        (p.name, p.stat().st_mtime_ns, p.read_text())
        for p in (pytester.path / "baselines").rglob("*.toml")
    }


def test_record_compare_regenerate(recorded, pytester):
    missing = recorded()
    missing.assert_outcomes(failed=2)
    missing.stdout.fnmatch_lines(
        ["rattle: there is no baseline *; record it: pytest '*' --rattle-baselines=record"]
    )
    assert not (pytester.path / "baselines").exists()

    first_run = recorded("--rattle-baselines=record")
    first_run.assert_outcomes(passed=2)
    first_run.stdout.fnmatch_lines(
        ["baselines  0 as recorded, 2 written", "*recorded *test_recorded*.toml"]
    )
    first = files(pytester)
    assert len(first) == 2  # names that a file cannot have are still distinguished

    same = recorded(shift=1e-7)  # within the tolerance
    same.assert_outcomes(passed=2)
    same.stdout.fnmatch_lines(["baselines  2 as recorded, 0 written"])
    other = recorded(sigma=0.03)
    other.assert_outcomes(failed=2)
    other.stdout.fnmatch_lines(["  scene.sigma: 0.02 -> 0.03"])

    for mode in ("compare", "record"):  # recording does not overwrite
        changed = recorded(f"--rattle-baselines={mode}", shift=0.25)
        changed.assert_outcomes(failed=2)
        changed.stdout.fnmatch_lines(
            ["rattle: model differs from its baseline *", "  values.y1.2: 1.03* -> 1.28*"]
        )
        changed.stdout.fnmatch_lines(["If that is meant: pytest '*' --rattle-baselines=regenerate"])
    assert files(pytester) == first

    regenerated = recorded("--rattle-baselines=regenerate", "-k", "one", shift=0.25)
    regenerated.assert_outcomes(passed=1, deselected=1)
    regenerated.stdout.fnmatch_lines(["*regenerated *one*.toml", "*values.y1.2: 1.03* -> 1.28*"])
    assert len(files(pytester) - first) == 1


def test_a_damaged_file_is_named(recorded, pytester):
    recorded("--rattle-baselines=record")
    for path in (pytester.path / "baselines").rglob("*.toml"):
        path.write_text("[values\n")
    result = recorded()
    result.assert_outcomes(failed=2)
    result.stdout.fnmatch_lines(
        ["rattle: baseline = '*.toml': is damaged *restore it, or remove and record it"]
    )
