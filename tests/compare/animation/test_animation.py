"""The animation: what is recorded, how the teeth are drawn, and the file that is written."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from commands import rattle
from matplotlib.path import Path as Polygon

from rattle import InputError
from rattle.closure import follow
from rattle.compare.animation.page import (
    GENERATOR,
    MOST_PAGE_BYTES,
    PLAY,
    TOOTH,
    Wheel,
    animation,
    check_file,
    outline,
)
from rattle.compare.animation.record import (
    ANIMATED_SCHEME,
    FEWEST_INSTANTS,
    MOST_IMPACTS_SHOWN,
    record,
)
from rattle.montecarlo import Record, default_step, simulate
from rattle.scene import DAT21, OutputError, Scene, Start, Tolerance

ROOT = Path(__file__).resolve().parents[3]
GEARS = Scene.from_gears(DAT21, sigma=0.1)
PLAIN = {"epsilon": 0.9, "beta1": 0.1, "beta2": 0.1, "gamma1": 0.1, "gamma2": 0.1, "mu": 0.5}
SCENES = {
    "gears": GEARS,
    "single stage": Scene.from_gears(DAT21, sigma=0.1, stages=1),
    "tolerance": Scene.from_gears(DAT21, tolerance=Tolerance(0.1, 0.05)),
    "contact": Scene.from_gears(
        DAT21, sigma=0.1, tolerance=Tolerance(0.1, 0.05, "normal", "contact")
    ),
    "late": Scene.from_gears(DAT21, sigma=0.1, start=Start(1e12, 0.5, 2.0, 0.5, 2.0, 1)),
    "in flight": Scene(alpha=1.5, **PLAIN, sigma=0.1, start=Start()),
    "strong drive": Scene(alpha=1e5, **PLAIN, sigma=10.0),
    "narrow gap": Scene(alpha=1.5, **PLAIN, gap2=1e-4, sigma=0.1),
}
HOSTILE = "<script>alert(1)</script>\"'&{{ 7 * 7 }}</title>\x1b[31m\u202ename"


@pytest.fixture(scope="module")
def shown():
    return record(GEARS, impacts=8, seed=1)


@pytest.fixture(scope="module")
def page(shown):
    return animation(shown, "DAT21", "rattle animate")


@pytest.mark.parametrize("name", SCENES)
def test_recorded_paths(name):
    scene = SCENES[name]
    shown = record(scene, impacts=6, seed=3)
    orbit = follow(scene.noise_free, 6)
    np.testing.assert_allclose(shown.orbit.impact_time, orbit.tau[1:] - scene.phase, rtol=1e-12)
    for motion in (shown.orbit, shown.path):
        assert (np.diff(motion.time) > 0.0).all()
        assert motion.time[0] == 0.0
        assert motion.time[-1] <= shown.span
        assert np.isin(motion.impact_time, motion.time).all()
        assert (np.sign(motion.impact_x) == np.sign(motion.code)).all()
        for x, wall in zip((motion.x1, motion.x2)[: scene.stages], scene.windows, strict=False):
            assert np.abs(x).max() <= wall * (1.0 + 1e-12)
        assert np.isnan(motion.x2).all() == (scene.stages == 1)
    middle = shown.orbit.time[len(shown.orbit.time) // 2]
    state = orbit.state(middle + scene.phase)[::2][: scene.stages]
    np.testing.assert_allclose(
        [shown.orbit.x1[shown.orbit.time == middle][0], *state[1:]], state, rtol=1e-9
    )
    assert len(animation(shown, name)) < MOST_PAGE_BYTES


def test_the_path_is_the_simulated_one(shown):
    """Another run of the sampler, with another number of impacts, strikes at the same times."""
    dt = min(default_step(GEARS, ANIMATED_SCHEME), shown.span / FEWEST_INSTANTS)
    raw = simulate(
        GEARS, paths=1, impacts=60, dt=dt, scheme=ANIMATED_SCHEME, rng=1, record=Record(raw=True)
    ).raw[0]
    raw = raw[raw[:, 0] <= shown.span]
    assert shown.path.impacts == len(raw)
    np.testing.assert_array_equal(shown.path.impact_time, raw[:, 0])
    np.testing.assert_array_equal(shown.path.code, raw[:, 6])


def polygon(wheel, degrees, centre):
    """Outline of a wheel, with its arcs as chords, turned clockwise on a screen and moved."""
    text = re.sub(r"A\S+ \S+ 0 0 1 ", " ", outline(wheel))
    numbers = np.array([float(n) for n in re.findall(r"-?\d+\.\d+", text)]).reshape(-1, 2)
    c = math.cos(math.radians(degrees))
    s = math.sin(math.radians(degrees))
    return numbers @ np.array([[c, s], [-s, c]]) + [centre, 0.0]


@pytest.mark.parametrize("drive", [-1.3, -0.4, 0.0, 0.25, 0.9, 3.7])
@pytest.mark.parametrize("side", [1, -1])
def test_teeth_touch_where_the_backlash_ends(drive, side):
    """Drawn as the script draws them: apart inside the gap, on each other beyond it, whatever the
    rotation."""
    radius = 1000.0
    gap = 0.5
    wheel = Wheel(radius, TOOTH)
    scale = PLAY * wheel.pitch / (2.0 * gap)
    driver = Wheel(radius, 1.0 - TOOTH - PLAY)

    def overlap(x1):
        turn = math.degrees(scale / radius)
        one = polygon(wheel, 15.0 + turn * (drive - x1), 0.0)
        other = polygon(driver, -turn * drive, -2.0 * radius)
        return (
            Polygon(one).contains_points(other).any() or Polygon(other).contains_points(one).any()
        )

    assert not overlap(0.98 * side * gap)
    assert overlap(1.06 * side * gap)


def test_the_file_is_alone_and_small(page):
    assert len(page.encode()) < MOST_PAGE_BYTES
    assert not re.search(
        r"https?:|//[a-z]|@import|url\(|\bsrc=|<link|<iframe|\bfetch\(|\bstyle=|\bon[a-z]+=", page
    )
    assert all(address.startswith("#") for address in re.findall(r'href="([^"]*)"', page))
    assert "default-src &#39;none&#39;" in page
    assert GENERATOR in page[:1000]
    assert "prefers-reduced-motion" in page
    assert "prefers-color-scheme: dark" in page


def test_one_flash_for_each_impact(shown, page):
    data = json.loads(re.search(r'id="data">(.*?)</script>', page, re.DOTALL)[1])
    for key, motion, given in zip(
        ("orbit", "path"), (shown.orbit, shown.path), data["paths"], strict=True
    ):
        assert len(given["hits"]) == len(given["codes"]) == motion.impacts
        marks = re.findall(rf'class="mark {key}" data-k="(\d+)"', page)
        assert sorted(map(int, marks)) == list(range(motion.impacts))
        np.testing.assert_allclose(given["hits"], motion.impact_time, rtol=1e-6)


def test_hostile_names_are_escaped(shown):
    page = animation(shown, HOSTILE, HOSTILE)
    assert page.count("<script") == 2
    assert page.count("</title>") == 1
    assert "<script>alert" not in page
    assert "\x1b" not in page
    assert "\u202e" not in page
    assert "{{ 7 * 7 }}" in page


@pytest.mark.parametrize(
    ("scene", "settings", "message"),
    [
        (GEARS.with_sigma(0.0), {}, r"^sigma = 0.0: nothing is random.*give noise"),
        (GEARS, {"impacts": 0}, "^impacts = 0: must be at least 1"),
        (GEARS, {"impacts": MOST_IMPACTS_SHOWN + 1}, "^impacts = 201: must be at most 200"),
        (GEARS, {"impacts": 2.5}, "^impacts = 2.5: give a whole number"),
        (GEARS, {"seed": -1}, "^seed = -1: must be at least 0"),
        (
            Scene(alpha=0.0, **PLAIN | {"gamma1": 0.0, "gamma2": 0.0}, sigma=0.1),
            {},
            "^impacts = 24: .*give at most",
        ),
        (
            Scene(alpha=1.5, **PLAIN | {"epsilon": 0.0}, sigma=0.1),
            {"impacts": 200},
            "^impacts = 200: .*2000.*",
        ),
    ],
)
def test_bad_settings(scene, settings, message):
    with pytest.raises(InputError, match=message):
        record(scene, **settings)


def test_what_may_be_replaced(tmp_path, page):
    ours = tmp_path / "ours.html"
    foreign = tmp_path / "foreign.html"
    ours.write_text(page)
    foreign.write_text("<p>mine</p>")
    check_file(tmp_path / "new" / "a.html", False)
    check_file(ours, True)
    for out, overwrite, why in (
        (ours, False, r"overwrite it \(--overwrite\)"),
        (foreign, True, "not an animation of rattle"),
        (tmp_path / "a.svg", False, r"ends in \.html"),
        (foreign / "a.html", False, "cannot be written"),
    ):
        with pytest.raises(OutputError, match=why):
            check_file(out, overwrite)
    (tmp_path / "folder.html").mkdir()
    with pytest.raises(OutputError, match="not a file"):
        check_file(tmp_path / "folder.html", True)


def test_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "<b>mine.toml").write_text(GEARS.to_toml())
    words = ["animate", "<b>mine.toml", "--sigma", "0.05", "--impacts", "3", "--seed", "2"]
    done = rattle(*words)
    out = tmp_path / "reports" / "<b>mine-animation.html"
    assert "3 impacts without noise" in done.output
    assert "σ = 0.05" in out.read_text()
    assert "<b>" not in out.read_text()
    assert "overwrite it (--overwrite)" in rattle(*words, code=2).output
    rattle(*words, "--overwrite")
    assert [p.name for p in out.parent.iterdir()] == [out.name]


def test_the_documentation_shows_the_animation_of_today():
    """Made anew by ``rattle animate --out docs/_static/animation.html --overwrite``."""
    page = (ROOT / "docs" / "_static" / "animation.html").read_text()
    assert len(page.encode()) < MOST_PAGE_BYTES
    for part in ("animation.css", "animation.js"):
        assert (ROOT / "compare" / "animation" / "templates" / part).read_text() in page
