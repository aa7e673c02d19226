"""The animation in a real browser: loading, layout, one flash for each impact, bodies on their
walls, controls, reduced motion."""

import pytest
from places import EXAMPLES
from scenes import dat21

from rattle import Scene, animate

FLASHES = (
    "paths.map(p => p.flashes.map(f => f.style.visibility === 'visible' ? Number(f.dataset.impact)"
    " : 0))"
)
OVERLAPS = """(() => {
  const boxes = [...document.querySelectorAll(
      'h2, .state, .now, .buttons > *, figcaption, .tick, .axis text')]
    .map(e => [e.textContent, e.getBoundingClientRect()]);
  return boxes.flatMap(([one, a], i) => boxes.slice(i + 1).filter(([, b]) =>
    a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 3 && b.top < a.bottom - 3)
    .map(([other]) => [one, other]));
})()"""


@pytest.fixture(scope="module")
def drawn():
    return animate(dat21(0.1), impacts=8, rng=1, name="<b>DAT21</b>" + "long" * 60)


@pytest.fixture(scope="module")
def shown(drawn):
    return drawn.recording


@pytest.fixture(scope="module")
def page(drawn, tmp_path_factory):
    return drawn.save(tmp_path_factory.mktemp("page") / "animation.html")


LAYOUT = f"""[document.documentElement.scrollWidth > document.documentElement.clientWidth,
  [...document.querySelectorAll('svg text')].some(t => t.getBoundingClientRect().height <= 11),
  {OVERLAPS.removesuffix(";")}]"""


def is_in_order(browser):
    """Whether a page has no complaint, fits, and has no text that is small or lies upon another."""
    return browser.complaints() == [] and browser.run(LAYOUT) == [False, False, []]


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
def test_loads_alone_and_fits(browser, page, width, scheme):
    browser.open(page, width, scheme=scheme)
    assert is_in_order(browser)
    paper = browser.run("getComputedStyle(document.body).backgroundColor")
    assert (paper == "rgb(255, 255, 255)") == (scheme == "light")


def test_each_impact_flashes_at_its_mesh(browser, page, shown):
    browser.open(page)
    browser.run("set(false)")
    for i, motion in enumerate((shown.orbit, shown.path)):
        for k, mesh in enumerate(abs(motion.code)):
            assert browser.run(f"go(paths[{i}].hits[{k}]), {FLASHES}")[i][mesh - 1] == k + 1
    assert browser.run(f"go(0), {FLASHES}") == [[0, 0], [0, 0]]
    assert browser.run(f"go(paths[0].hits[0] - 1e-6), {FLASHES}")[0] == [0, 0]


CLEAR = """(i => {
  const picture = document.querySelectorAll('.bodies')[i], half = 18;
  const place = part => part.getCTM().f / part.getCTM().a;
  const body = place(picture.querySelector('.body'));
  const walls = [...picture.querySelectorAll('.wall')].map(wall => {
    const upper = place(wall) + wall.y.baseVal.value, below = wall.y.baseVal.value > 0;
    return below ? upper - (body + half) : body - half - (upper + wall.height.baseVal.value);
  });
  return [walls[0], walls.at(-1)];
})"""
"""How far a drawn body is from its walls + and -."""


@pytest.mark.parametrize("name", ["ball", "oscillator", "impact-pair"])
def test_a_body_is_on_its_wall_at_an_impact_and_never_beyond(browser, name, tmp_path):
    drawn = animate(Scene.load(EXAMPLES / f"{name}.toml"), impacts=6, rng=1)
    browser.open(drawn.save(tmp_path / "bodies.html"), 390)
    assert is_in_order(browser)
    browser.run("set(false)")
    for i, motion in enumerate((drawn.recording.orbit, drawn.recording.path)):
        for k, code in enumerate(motion.code):
            clear = browser.run(f"go(paths[{i}].hits[{k}]), {CLEAR}({i})")
            assert clear[0 if code > 0 else 1] == pytest.approx(0.0, abs=0.02)
        all_along = f"[...Array(500).keys()].flatMap(k => (go(k / 500 * data.span), {CLEAR}({i})))"
        distances = browser.run(all_along)
        assert min(distances) > -0.02
        assert max(distances) > 50.0


def later(browser, script, milliseconds=200):
    """The value of a script after a time."""
    return browser.run(f"new Promise(done => setTimeout(() => done({script}), {milliseconds}))")


def test_controls(browser, page, shown):
    browser.open(page)
    assert browser.run("running && play.textContent === 'Pause'")
    assert later(browser, "now > 0", 400)
    still = browser.run("play.click(), now")
    assert later(browser, "now") == still
    first = min(shown.orbit.impact_time[0], shown.path.impact_time[0])
    for click, time in (
        ("go(0), find('next').click()", first),
        ("find('next').click(), find('back').click()", first),
        ("find('back').click()", 0.0),
        ("slider.value = 0.5, slider.dispatchEvent(new Event('input'))", 0.5 * shown.span),
    ):
        assert browser.run(f"{click}, now") == pytest.approx(time, rel=1e-6)
    stated = float(browser.run("find('tau').textContent"))
    assert stated == pytest.approx(0.5 * shown.span, abs=0.01)
    browser.run("location.hash = '#t=2'")
    assert later(browser, "[now, find('phase').textContent]") == [2.0, "114°"]


def test_reduced_motion(browser, page):
    """Nothing moves unasked, and what is played goes from impact to impact."""
    browser.open(page, motion="reduce")
    assert later(browser, "[running, now]", 300) == [False, 0]
    browser.run("speed.value = '2', play.click()")
    times = browser.run(
        "new Promise(done => { const seen = []; const timer = setInterval(() => { seen.push(now);"
        " if (seen.length === 12) { clearInterval(timer); done(seen); } }, 100); })"
    )
    assert set(times) <= {0, *browser.run("instants")}
    assert max(times) > 0
