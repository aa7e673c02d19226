"""What a command does, Python does too: animations and chaos; and every public result has a short
repr."""

import pytest

import rattle as rt
from rattle.compare.animation.page import GENERATOR
from rattle.scene import OutputError

SCENE = rt.Scene.from_gears(rt.DAT21, sigma=0.1)
LONGEST = 700  # characters of a repr: a dozen lines in a notebook


def test_an_animation_is_shown_and_written(tmp_path):
    found = rt.animate(SCENE, impacts=4, rng=3)
    assert repr(found).startswith("Animation: 4 impacts without noise")
    assert "<iframe srcdoc=" in found._repr_html_()
    path = found.save(tmp_path / "gears.html")
    assert GENERATOR in path.read_text()
    with pytest.raises(OutputError, match=r"exists; choose another name"):
        found.save(path)
    assert found.save(path, overwrite=True) == path
    with pytest.raises(rt.InputError, match=r"sigma = 0\.0: nothing is random"):
        rt.animate(SCENE.with_sigma(0.0))


@pytest.fixture(scope="module")
def measured():
    return rt.chaos(SCENE, points=500, impacts=20_000, events=128, width=0.3)


def test_chaos_says_what_it_found(measured, tmp_path):
    assert "chaotically" in measured.answer[0]
    assert "exponents" in measured.tables
    assert "<table" in measured._repr_html_()
    page = measured.report(tmp_path / "chaos")
    assert page.is_file()
    with pytest.raises(OutputError):
        measured.report(tmp_path / "chaos")
    again = rt.chaos(SCENE, points=500, impacts=20_000, events=128, width=0.3)
    assert again.tables["exponents"].equals(measured.tables["exponents"])


def test_chaos_refuses_before_any_work():
    with pytest.raises(
        rt.InputError, match="field = 'backlash': did you mean 'backlash1' or 'backlash2'"
    ):
        rt.chaos(SCENE, field="backlash", over=[0.2])
    with pytest.raises(rt.InputError, match="points = 3"):
        rt.chaos(SCENE, points=3)


def test_every_result_has_a_short_repr_and_most_a_table(measured):
    settings = {"between": (0.01, 0.1), "impacts": 1, "points": 2}
    closure = rt.mean_map(SCENE, impacts=12, closure="branching")
    results = {
        "orbit": rt.follow(SCENE, 200),
        "closure": closure,
        "trace": closure.trace,
        "edgeworth": rt.mean_map(SCENE, impacts=2, closure="corrected").edgeworth(1, 1),
        "run": rt.simulate(
            SCENE, paths=1000, impacts=12, record=rt.Record(raw=True, histogram=True)
        ),
        "validation": rt.validate(SCENE, impacts=4, paths=1000),
        "stationary": rt.stationary(SCENE, periods=64, paths=16),
        "boundary": rt.boundary(SCENE, **settings),
        "chaos": measured,
        "gears": rt.DAT21,
        "scene": SCENE,
        "reach": rt.simulate_to(SCENE, 0.1, impacts=2).reach,
        "study": rt.Study.from_toml("[study]\nimpacts = 2\npaths = 1024\n" + SCENE.to_toml()),
    }
    assert {
        name: len(text) for name, found in results.items() if len(text := repr(found)) > LONGEST
    } == {}
    tables = {"orbit", "closure", "run", "validation", "stationary", "boundary", "chaos"}
    assert {name for name in tables if "<table" not in results[name]._repr_html_()} == set()


def test_raw_records_have_names():
    late = rt.Scene.from_gears(
        rt.DAT21, sigma=0.1, start=rt.Start(100.0, 0.5, 2.0, 0.5, 2.0, mesh=1)
    )
    run = rt.simulate(late, paths=16, impacts=3, record=rt.Record(raw=True))
    table = run.records
    assert table.index.names == ["path", "impact"]
    assert list(table) == ["tau", "flight", "x1", "y1", "x2", "y2", "mesh", "side"]
    assert len(table) == 48
    assert table["tau"].groupby("impact").mean().tolist() == pytest.approx(
        run.section["tau"].tolist()
    )
    assert table.loc[(0, 1), "y1"] == run.raw[0, 0, 3]
    with pytest.raises(rt.InputError, match=r"record\.raw = False: ask for it"):
        rt.simulate(late, paths=16, impacts=3).records  # noqa: B018
