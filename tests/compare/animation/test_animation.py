"""The animation: what is recorded, how the teeth are drawn, and the file that is written."""

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from commands import rattle
from matplotlib.path import Path as Polygon
from matplotlib.transforms import Affine2D
from places import ROOT
from refusals import refusal
from scenes import STICKING, dat21

from rattle import Record, Scene, Start, Tolerance, Wheel, animate, follow, simulate
from rattle.compare.animation import record
from rattle.compare.animation.teeth import (
    PLAY,
    TOOTH,
    DrawnWheel,
    outline,
    place_toothings,
)
from rattle.montecarlo import default_step
from rattle.scene import OutputError

PAPER_GEARS = dat21(0.1)
ANIMATED = {
    "single stage": dat21(0.1, stages=1),
    "contact": dat21(0.1, tolerance=Tolerance(0.1, 0.05, "normal", "contact")),
    "late": dat21(0.1, start=Start(1e12, 0.5, 2.0, 0.5, 2.0, 1)),
    "in flight": dat21(0.1, start=Start()),
    "strong drive": replace(dat21(10.0), alpha=1e5, start=None),
}
MOST_BYTES = 1_000_000


@pytest.fixture(scope="module")
def shown():
    return animate(PAPER_GEARS, impacts=8, name="DAT21")


@pytest.mark.parametrize("name", ANIMATED)
def test_recorded_paths(name):
    scene = ANIMATED[name]
    drawn = animate(scene, impacts=6)
    recording = drawn.recording
    orbit = follow(scene.noise_free, 6)
    np.testing.assert_allclose(recording.orbit.impact_time, orbit.tau[1:] - scene.phase, rtol=1e-12)
    for motion in (recording.orbit, recording.path):
        assert (np.diff(motion.time) > 0.0).all()
        assert motion.time[0] == 0.0
        assert np.isin(motion.impact_time, motion.time).all()
        assert (np.sign(motion.impact_x) == np.sign(motion.code)).all()
        assert (np.abs(motion.x) <= np.array(scene.windows) * (1.0 + 1e-12)).all()
    np.testing.assert_allclose(
        recording.orbit.x[-2], orbit.state(recording.orbit.time[-2] + scene.phase)[::2], rtol=1e-9
    )
    assert len(drawn.html) < MOST_BYTES


def test_the_path_is_the_simulated_one(shown):
    """Another run of the sampler, with another number of impacts, strikes at the same times."""
    recording = shown.recording
    # at least 200 instants
    dt = min(default_step(PAPER_GEARS, "exact-flight"), recording.span / 200)
    run = simulate(PAPER_GEARS, paths=1, impacts=60, dt=dt, record=Record(raw=True))
    records = run.records[run.records["tau"] <= recording.span]
    assert recording.path.impact_time.tolist() == records["tau"].tolist()
    assert recording.path.code.tolist() == (records["mesh"] * records["side"]).tolist()


def test_a_settled_start_is_an_impact_of_the_orbit():
    scene = dat21(1e-9)  # no path leaves the orbit so soon
    recording = animate(scene, periods=1).recording
    orbit = follow(scene.noise_free, 1200)
    begin = float(recording.scene.start.tau)
    (k,) = np.flatnonzero(np.isclose(orbit.tau, begin, rtol=1e-12))
    assert orbit.tau[k - 1] - scene.phase <= 64 * 2.0 * math.pi < orbit.tau[k] - scene.phase
    assert recording.agreement == recording.orbit.impacts
    assert recording.span == pytest.approx(2.0 * math.pi)


def test_a_long_path_is_sampled_in_parts(monkeypatch):
    monkeypatch.setattr(record, "most_impacts", lambda scene: 3)
    recording = animate(dat21(1e-9), impacts=10).recording
    np.testing.assert_allclose(recording.path.impact_time, recording.orbit.impact_time, atol=1e-5)
    assert (np.diff(recording.path.time) > 0.0).all()
    # an instant is rounded to the step, and one just after the begin of a part may be left out
    assert 0 <= len(recording.orbit.time) - len(recording.path.time) <= 4


def test_of_very_many_impacts_the_hardest_are_marked():
    drawn = animate(STICKING["mesh 1"].with_sigma(0.1), periods=6)
    path = drawn.recording.path
    assert len(path.number) == 600
    assert (np.diff([*path.number, path.impacts + 1]) > 0).all()
    assert "only the hardest 600" in drawn.html
    assert len(drawn.html) < MOST_BYTES


def polygon(wheel, degrees, centre):
    """Outline of a wheel, with its arcs as chords, turned clockwise on a screen and moved."""
    text = re.sub(r"A\S+ \S+ 0 0 1 ", " ", outline(wheel))
    numbers = np.array(re.findall(r"-?\d+\.\d+", text), float).reshape(-1, 2)
    return Polygon(Affine2D().rotate_deg(degrees).translate(centre, 0.0).transform(numbers))


@pytest.mark.parametrize("drive", [-1.3, 3.7])
@pytest.mark.parametrize("side", [1, -1])
def test_teeth_touch_where_the_backlash_ends(drive, side):
    """Drawn as the script draws them: apart inside the gap, on each other beyond it, whatever the
    rotation."""
    wheel = DrawnWheel(1000.0, TOOTH)
    driver = DrawnWheel(1000.0, 1.0 - TOOTH - PLAY)
    turn = math.degrees(PLAY * wheel.pitch / 1000.0)  # by a whole backlash

    def overlap(x1):
        one = polygon(wheel, 15.0 + turn * (drive - x1), 0.0)
        return one.intersects_path(polygon(driver, -turn * drive, -2000.0))

    assert not overlap(0.49 * side)
    assert overlap(0.53 * side)


SYSTEMS = {
    "a ball within another": Scene(
        alpha=1.0,
        epsilon=0.8,
        sigma=0.05,
        noise=2,
        wheels=[Wheel(gamma=0.2, gap=0.8), Wheel(gap=0.4, mass=0.3, parent=1, ratio=0.7)],
        start=Start(y1=1.0, y2=0.5),
    ),
} | {
    name: Scene.load(ROOT / "examples" / f"{name}.toml")
    for name in ("ball", "oscillator", "impact-pair")
}


def script_data(page):
    """What the script of an animation is given."""
    return json.loads(re.search(r'id="data">(.*?)</script>', page, re.DOTALL)[1])


@pytest.mark.parametrize("name", SYSTEMS)
def test_bodies_are_drawn_where_the_model_has_them(name):
    """Driver and bodies at their places in one scale, up is up; a body is on a wall at each impact
    there, never beyond one, and its spring reaches from the frame to it."""
    scene = SYSTEMS[name]
    drawn = animate(scene, impacts=8)
    data = script_data(drawn.html)
    scale = -data["parts"][0][1]
    assert scale > 0.0
    columns = (
        drawn.html.split('<svg class="wheels bodies')[1]
        .split("</svg>")[0]
        .split('<g class="moving frame')[1:]
    )
    rounding = 0.02  # of a height in the file
    recording = drawn.recording
    for motion, given in zip((recording.orbit, recording.path), data["paths"], strict=True):
        xs = np.array(given["x"])
        np.testing.assert_allclose(xs, motion.x.T, rtol=5.1e-4, atol=1e-12)  # four digits
        # x is driver less body, and between two bodies the second less the one that it strikes
        places = [scene.alpha * np.sin(scene.phase + np.array(given["t"]))]
        for wheel, x in zip(scene.tree, xs, strict=True):
            struck = wheel.ratio * places[wheel.parent]
            places.append(struck + x if wheel.parent else struck - x)
        drawn_at = iter([rest + factor * [*places, *xs][i] for i, factor, rest, _ in data["parts"]])
        for i, (wheel, column) in enumerate(zip(scene.tree, columns, strict=True), 1):
            frame = next(drawn_at)
            np.testing.assert_allclose(frame, -scale * wheel.ratio * places[wheel.parent])
            spring = next(drawn_at) if wheel.stiffness else 0.0
            body = next(drawn_at)
            np.testing.assert_allclose(body, -scale * places[i])
            assert (next(drawn_at) == frame).all()  # what flashes
            radius = float(re.search(r'class="body".* (?:r|y)="-?(\S+?)"', column)[1])
            if wheel.stiffness:
                anchor = float(re.search(r"0 (\S+)\).><path class=.moving spring", column)[1])
                np.testing.assert_allclose(frame + anchor + spring, body - radius, atol=rounding)
            walls = re.findall(r'class="wall".* y="(\S+)".* height="(\S+)"', column)
            assert len({y for y, _ in walls}) == 2 - wheel.one_sided
            for side, wall in zip((1, -1), (walls[0], walls[-1]), strict=True):
                y, height = map(float, wall)
                below = frame + y - body
                clear = below - radius if y > 0.0 else -below - height - radius
                struck = np.isin(motion.time, motion.impact_time[motion.code == i * side])
                assert np.abs(clear[struck]).max(initial=0.0) < rounding
                assert clear.min() > -rounding
                assert clear.max() > radius


def test_the_file_is_alone_and_small(shown):
    page = shown.html
    assert len(page.encode()) < MOST_BYTES
    assert not re.search(
        r"https?:|//[a-z]|@import|url\(|\bsrc=|<link|<iframe|\bfetch\(|\bstyle=|\bon[a-z]+=", page
    )
    assert all(address.startswith("#") for address in re.findall(r'href="([^"]*)"', page))
    assert '<meta name="generator" content="rattle animate">' in page[:1000]
    assert "default-src &#39;none&#39;" in page


def test_one_flash_for_each_impact(shown):
    page = shown.html
    for key, given in zip(("orbit", "path"), script_data(page)["paths"], strict=True):
        motion = getattr(shown.recording, key)
        marks = map(int, re.findall(rf'class="mark {key}" data-k="(\d+)"', page))
        assert sorted(marks) == list(range(motion.impacts))
        assert given["codes"] == motion.code.tolist()
        np.testing.assert_allclose(given["hits"], motion.impact_time, rtol=1e-6)


def test_hostile_names_are_escaped():
    page = animate(
        PAPER_GEARS,
        impacts=1,
        name="<script>alert(1)</script>\"'&{{ 7 * 7 }}</title>\x1b[31m\u202ename",
    ).html
    assert page.count("<script") == 2
    assert page.count("</title>") == 1
    assert not re.search("<script>alert|\x1b|\u202e", page)
    assert "{{ 7 * 7 }}" in page


@pytest.mark.parametrize(
    ("scene", "settings", "message"),
    [
        (PAPER_GEARS.with_sigma(0.0), {}, r"^sigma = 0.0: nothing is random.*give noise"),
        (
            PAPER_GEARS,
            {"impacts": 2000},
            r"^impacts = 2000: take over 60 periods; give at most \d+$",
        ),
        (PAPER_GEARS, {"periods": 61}, "^periods = 61: must be at most 60"),
        (PAPER_GEARS, {"periods": 2, "impacts": 2}, "^impacts = 2: goes without periods"),
        (
            replace(dat21(0.001), alpha=0.01, start=None),
            {},
            "^periods = 4: the noise-free orbit ends before it settles .*give impacts",
        ),
    ],
)
def test_bad_settings(scene, settings, message):
    with refusal(message):
        animate(scene, **settings)


def test_it_is_shown_and_written_where_nothing_else_is(shown, tmp_path):
    assert repr(shown).startswith("Animation: 8 impacts without noise")
    assert "<iframe srcdoc=" in shown._repr_html_()
    assert shown.save(tmp_path / "ours.html").read_text() == shown.html
    foreign = tmp_path / "foreign.html"
    foreign.write_text("<p>mine</p>")
    for place, why in {
        foreign: "not an animation of rattle",
        tmp_path / "a.svg": r"ends in \.html",
        foreign / "a.html": "cannot be written",
    }.items():
        with pytest.raises(OutputError, match=why):
            shown.save(place, overwrite=True)


def test_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "<b>mine.toml").write_text(PAPER_GEARS.to_toml())
    words = "animate <b>mine.toml --sigma 0.05 --impacts 3 --seed 2"
    out = tmp_path / "reports/<b>mine-animation.html"
    assert "3 impacts without noise" in rattle(words).output
    assert "σ = 0.05" in out.read_text()
    assert "<b>" not in out.read_text()
    assert "overwrite it (--overwrite)" in rattle(words, code=2).output
    rattle(f"{words} --overwrite")


@pytest.mark.parametrize("name", ["animation", "ball"])
def test_the_documentation_shows_the_animation_of_today(name):
    """Made anew by ``rattle animate --out docs/_static/animation.html --overwrite`` and ``rattle
    animate examples/ball.toml --impacts 6 --out docs/_static/ball.html --overwrite``."""
    page = (ROOT / "docs/_static" / f"{name}.html").read_text()
    assert len(page.encode()) < MOST_BYTES
    for part in ("animation.css", "animation.js"):
        assert (ROOT / "compare/animation/templates" / part).read_text() in page


def test_a_tree_is_laid_out_mesh_by_mesh():
    """Every wheel stands right of its parent's toothing, with its play between their teeth; no two
    toothings share a place."""
    box = Scene.load(ROOT / "examples/gearbox5.toml")
    plays = [0.1, 0.12, 0.14, 0.16, 0.18]
    drawn = place_toothings(box, plays)
    places = {(one.row, one.depth): one for one in drawn}
    assert len(places) == len(drawn)
    own = {one.body: one for one in drawn if one.is_own}
    for body, (wheel, play) in enumerate(zip(box.tree, plays, strict=True), 1):
        one = own[body]
        parent = places[one.row, one.depth - 1]
        assert (parent.body, parent.ratio) == (wheel.parent, wheel.ratio)
        assert parent.width + one.width == pytest.approx(1.0 - play)
        assert parent.factor * one.factor < 0.0
