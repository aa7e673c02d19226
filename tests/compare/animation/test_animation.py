"""The animation: what is recorded, how the teeth are drawn, and the file that is written."""

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from commands import rattle
from matplotlib.path import Path as Polygon
from places import ROOT
from refusals import refusal
from scenes import dat21

from rattle import (
    Record,
    Scene,
    Start,
    Tolerance,
    Wheel,
    animate,
    follow,
    simulate,
)
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
PLAIN_VALUES = {"alpha": 1.5, "beta1": 0.1, "beta2": 0.1, "gamma1": 0.1, "gamma2": 0.1, "mu": 0.5}
CONTACT = Tolerance(0.1, 0.05, "normal", "contact")
ANIMATED = {
    "gears": PAPER_GEARS,
    "single stage": dat21(0.1, stages=1),
    "contact": dat21(0.1, tolerance=CONTACT),
    "late": dat21(0.1, start=Start(1e12, 0.5, 2.0, 0.5, 2.0, 1)),
    "in flight": Scene(**PLAIN_VALUES, epsilon=0.9, sigma=0.1, start=Start()),
    "strong drive": Scene(**PLAIN_VALUES | {"alpha": 1e5}, epsilon=0.9, sigma=10.0),
}
HOSTILE = "<script>alert(1)</script>\"'&{{ 7 * 7 }}</title>\x1b[31m\u202ename"
MOST_BYTES = 1_000_000


@pytest.fixture(scope="module")
def shown():
    return animate(PAPER_GEARS, impacts=8, rng=1, name="DAT21")


@pytest.mark.parametrize("name", ANIMATED)
def test_recorded_paths(name):
    scene = ANIMATED[name]
    drawn = animate(scene, impacts=6, rng=3, name=name)
    recording = drawn.recording
    orbit = follow(scene.noise_free, 6)
    times = orbit.tau[1:] - scene.phase
    np.testing.assert_allclose(recording.orbit.impact_time, times, rtol=1e-12)
    for motion in (recording.orbit, recording.path):
        assert (np.diff(motion.time) > 0.0).all()
        assert motion.time[0] == 0.0
        assert np.isin(motion.impact_time, motion.time).all()
        assert (np.sign(motion.impact_x) == np.sign(motion.code)).all()
        assert (np.abs(motion.x) <= np.array(scene.windows) * (1.0 + 1e-12)).all()
    middle = len(recording.orbit.time) // 2
    state = orbit.state(recording.orbit.time[middle] + scene.phase)
    np.testing.assert_allclose(recording.orbit.x[middle], state[::2], rtol=1e-9)
    assert len(drawn.html) < MOST_BYTES


def test_the_path_is_the_simulated_one(shown):
    """Another run of the sampler, with another number of impacts, strikes at the same times."""
    recording = shown.recording
    instants = 200  # at least
    dt = min(default_step(PAPER_GEARS, "exact-flight"), recording.span / instants)
    run = simulate(
        PAPER_GEARS,
        paths=1,
        impacts=60,
        dt=dt,
        scheme="exact-flight",
        rng=1,
        record=Record(raw=True),
    )
    records = run.records[run.records["tau"] <= recording.span]
    assert recording.path.impact_time.tolist() == records["tau"].tolist()
    assert recording.path.code.tolist() == (records["mesh"] * records["side"]).tolist()


def test_a_settled_start_is_an_impact_of_the_orbit():
    scene = replace(PAPER_GEARS, sigma=1e-9)  # no path leaves the orbit so soon
    recording = animate(scene, periods=1).recording
    orbit = follow(scene.noise_free, 1200)
    begin = float(recording.scene.start.tau)
    (k,) = np.flatnonzero(np.isclose(orbit.tau, begin, rtol=1e-12))
    assert orbit.tau[k - 1] - scene.phase <= 64 * 2.0 * math.pi < orbit.tau[k] - scene.phase
    assert recording.agreement == recording.orbit.impacts
    assert recording.span == pytest.approx(2.0 * math.pi)


def test_a_long_path_is_sampled_in_parts(monkeypatch):
    monkeypatch.setattr(record, "most_impacts", lambda scene: 3)
    scene = dat21(1e-9)
    recording = animate(scene, impacts=10, rng=1).recording
    times = recording.orbit.impact_time
    np.testing.assert_allclose(recording.path.impact_time, times, atol=1e-5)
    assert (np.diff(recording.path.time) > 0.0).all()
    # an instant is rounded to the step, and one just after the begin of a part may be left out
    assert 0 <= len(recording.orbit.time) - len(recording.path.time) <= 4


def test_of_very_many_impacts_the_hardest_are_marked():
    chatter = Scene(**PLAIN_VALUES | {"gamma1": 0.8, "gamma2": 0.6}, epsilon=0.5, sigma=0.1)
    drawn = animate(chatter, periods=6)
    path = drawn.recording.path
    assert path.impacts > len(path.number) == 600
    assert (np.diff(path.number) > 0).all()
    assert path.number[-1] <= path.impacts
    assert "only the hardest 600" in drawn.html
    assert len(drawn.html) < MOST_BYTES


def polygon(wheel, degrees, centre):
    """Outline of a wheel, with its arcs as chords, turned clockwise on a screen and moved."""
    text = re.sub(r"A\S+ \S+ 0 0 1 ", " ", outline(wheel))
    numbers = np.array([float(n) for n in re.findall(r"-?\d+\.\d+", text)]).reshape(-1, 2)
    c = math.cos(math.radians(degrees))
    s = math.sin(math.radians(degrees))
    return numbers @ np.array([[c, s], [-s, c]]) + [centre, 0.0]


@pytest.mark.parametrize("drive", [-1.3, 0.0, 3.7])
@pytest.mark.parametrize("side", [1, -1])
def test_teeth_touch_where_the_backlash_ends(drive, side):
    """Drawn as the script draws them: apart inside the gap, on each other beyond it, whatever the
    rotation."""
    radius = 1000.0
    gap = 0.5
    wheel = DrawnWheel(radius, TOOTH)
    driver = DrawnWheel(radius, 1.0 - TOOTH - PLAY)
    turn = math.degrees(PLAY * wheel.pitch / (2.0 * gap) / radius)

    def overlap(x1):
        one = polygon(wheel, 15.0 + turn * (drive - x1), 0.0)
        other = polygon(driver, -turn * drive, -2.0 * radius)
        inside = Polygon(one).contains_points(other).any()
        return inside or Polygon(other).contains_points(one).any()

    assert not overlap(0.98 * side * gap)
    assert overlap(1.06 * side * gap)


SYSTEMS = {
    "two walls and a spring": Scene(
        alpha=1.0,
        epsilon=0.8,
        sigma=0.1,
        wheels=[Wheel(stiffness=4.0, beta=0.1, gap=0.3)],
        start=Start(y1=1.0),
    ),
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
    drawn = animate(scene, impacts=8, rng=1)
    data = script_data(drawn.html)
    scale = -data["parts"][0][1]
    assert scale > 0.0
    picture = drawn.html.split('<svg class="wheels bodies')[1].split("</svg>")[0]
    columns = picture.split('<g class="moving frame')[1:]
    orbit = follow(scene.noise_free, 8)
    recorded = drawn.recording.orbit
    rounding = 0.02  # of a height in the file
    for motion, given in zip((recorded, drawn.recording.path), data["paths"], strict=True):
        xs = np.array(given["x"])
        if motion is recorded:
            states = np.transpose([orbit.state(scene.phase + t)[::2] for t in motion.time])
            np.testing.assert_allclose(xs, states, rtol=5.1e-4, atol=1e-12)  # four digits
        # x is driver less body, and between two bodies the second less the one that it strikes
        places = [scene.alpha * np.sin(scene.phase + np.array(given["t"]))]
        for wheel, x in zip(scene.tree, xs, strict=True):
            struck = wheel.ratio * places[wheel.parent]
            places.append(struck + x if wheel.parent else struck - x)
        drawn_at = iter([rest + factor * [*places, *xs][i] for i, factor, rest, _ in data["parts"]])
        codes = dict(zip(given["hits"], given["codes"], strict=True))
        for i, (wheel, column) in enumerate(zip(scene.tree, columns, strict=True), 1):
            frame = next(drawn_at)
            np.testing.assert_allclose(frame, -scale * wheel.ratio * places[wheel.parent])
            spring = next(drawn_at) if wheel.stiffness else None
            body = next(drawn_at)
            np.testing.assert_allclose(body, -scale * places[i])
            assert (next(drawn_at) == frame).all()  # what flashes
            radius = float(re.search(r'class="body".* (?:r|y)="-?(\S+?)"', column)[1])
            if spring is not None:
                anchor = float(re.search(r"0 (\S+)\).><path class=.moving spring", column)[1])
                np.testing.assert_allclose(frame + anchor + spring, body - radius, atol=rounding)
            walls = re.findall(r'class="wall".* y="(\S+)".* height="(\S+)"', column)
            assert len({y for y, _ in walls}) == 2 - wheel.one_sided
            for side, (y, height) in zip((1, -1), (walls[0], walls[-1]), strict=True):
                upper = frame + float(y)
                lower = upper + float(height)
                clear = upper - body - radius if float(y) > 0.0 else body - radius - lower
                struck = np.array([codes.get(t) == i * side for t in given["t"]])
                assert struck.sum() == (motion.code == i * side).sum()
                assert np.abs(clear[struck]).max(initial=0.0) < rounding
                assert clear.min() > -rounding
                assert clear.max() > radius


def test_the_file_is_alone_and_small(shown):
    page = shown.html
    assert len(page.encode()) < MOST_BYTES
    asks = r"https?:|//[a-z]|@import|url\(|\bsrc=|<link|<iframe|\bfetch\(|\bstyle=|\bon[a-z]+="
    assert not re.search(asks, page)
    assert all(address.startswith("#") for address in re.findall(r'href="([^"]*)"', page))
    assert '<meta name="generator" content="rattle animate">' in page[:1000]
    assert "default-src &#39;none&#39;" in page


def test_one_flash_for_each_impact(shown):
    page = shown.html
    data = script_data(page)
    for key, given in zip(("orbit", "path"), data["paths"], strict=True):
        motion = getattr(shown.recording, key)
        assert len(given["codes"]) == motion.impacts
        marks = re.findall(rf'class="mark {key}" data-k="(\d+)"', page)
        assert sorted(map(int, marks)) == list(range(motion.impacts))
        np.testing.assert_allclose(given["hits"], motion.impact_time, rtol=1e-6)


def test_hostile_names_are_escaped():
    page = animate(PAPER_GEARS, impacts=1, name=HOSTILE).html
    assert page.count("<script") == 2
    assert page.count("</title>") == 1
    assert not [part for part in ("<script>alert", "\x1b", "\u202e") if part in page]
    assert "{{ 7 * 7 }}" in page


DYING = Scene(**PLAIN_VALUES | {"alpha": 0.01}, epsilon=0.5, sigma=0.001)


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
        (DYING, {}, "^periods = 4: the noise-free orbit ends before it settles .*give impacts"),
    ],
)
def test_bad_settings(scene, settings, message):
    with refusal(message):
        animate(scene, **settings)


def test_it_is_shown_and_written_where_nothing_else_is(shown, tmp_path):
    assert repr(shown).startswith("Animation: 8 impacts without noise")
    assert "<iframe srcdoc=" in shown._repr_html_()
    ours = shown.save(tmp_path / "ours.html")
    assert ours.read_text() == shown.html
    foreign = tmp_path / "foreign.html"
    foreign.write_text("<p>mine</p>")
    for place, overwrite, why in (
        (foreign, True, "not an animation of rattle"),
        (tmp_path / "a.svg", False, r"ends in \.html"),
        (foreign / "a.html", False, "cannot be written"),
    ):
        with pytest.raises(OutputError, match=why):
            shown.save(place, overwrite=overwrite)


def test_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "<b>mine.toml").write_text(PAPER_GEARS.to_toml())
    words = "animate <b>mine.toml --sigma 0.05 --impacts 3 --seed 2"
    out = tmp_path / "reports" / "<b>mine-animation.html"
    assert "3 impacts without noise" in rattle(words).output
    assert "σ = 0.05" in out.read_text()
    assert "<b>" not in out.read_text()
    assert "overwrite it (--overwrite)" in rattle(words, code=2).output
    rattle(f"{words} --overwrite")


@pytest.mark.parametrize("name", ["animation", "ball"])
def test_the_documentation_shows_the_animation_of_today(name):
    """Made anew by ``rattle animate --out docs/_static/animation.html --overwrite`` and ``rattle
    animate examples/ball.toml --impacts 6 --out docs/_static/ball.html --overwrite``."""
    page = (ROOT / "docs" / "_static" / f"{name}.html").read_text()
    assert len(page.encode()) < MOST_BYTES
    for part in ("animation.css", "animation.js"):
        assert (ROOT / "compare" / "animation" / "templates" / part).read_text() in page


def test_a_tree_is_laid_out_mesh_by_mesh():
    """Every wheel stands right of its parent's toothing, with its play between their teeth; no two
    toothings share a place."""
    box = Scene.load(ROOT / "examples" / "gearbox5.toml")
    plays = [0.1 + 0.02 * i for i in range(box.stages)]
    drawn = place_toothings(box, plays)
    places = {(one.row, one.depth): one for one in drawn}
    assert len(places) == len(drawn)
    own = [one for one in drawn if one.is_own]
    assert sorted(one.body for one in own) == list(range(1, box.stages + 1))
    for one in own:
        wheel = box.tree[one.body - 1]
        parent = places[one.row, one.depth - 1]
        assert (parent.body, parent.ratio) == (wheel.parent, wheel.ratio)
        assert parent.width + one.width == pytest.approx(1.0 - plays[one.body - 1])
        assert parent.factor * one.factor < 0.0
