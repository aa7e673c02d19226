"""The page in a real browser: loading, sorting, filtering, enlarged figures, layout, light and dark
styles."""

import pytest
from sample_page import NASTY, RECORD, figures, sample

from rattle.compare.report.render import write_page
from rattle.compare.report.report import Report
from rattle.compare.report.table import Table

COLUMN = (
    "[...document.querySelectorAll('section table')[0].rows].slice(1).map(row =>"
    " row.cells[{}].textContent)"
)
SPEED = "document.querySelectorAll('section table')[0].tHead.rows[0].cells[1]"
ROW_NAMES = ["saltation", "published", "corrected", "branching", "other", "a plain text"]
ROW_NAMES += [f"row {i}" for i in range(6)]


def written(tmp_path_factory, text):
    """A page of the sample with a text."""
    folder = figures(tmp_path_factory.mktemp("page") / "r")
    write_page(sample(text), folder)
    return folder / "report.html"


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    return written(tmp_path_factory, "a plain text")


@pytest.fixture(scope="module")
def nasty(tmp_path_factory):
    return written(tmp_path_factory, NASTY + "long" * 60)


@pytest.fixture(scope="module")
def report(validated):
    """A report of the command itself."""
    return validated / "report.html"


@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("name", ["page", "nasty", "report"])
def test_loads_alone_and_fits(browser, request, name, width):
    path = request.getfixturevalue(name)
    assert path.stat().st_size < 5_000_000
    browser.open(path, width)
    browser.run("document.querySelectorAll('details').forEach(folded => { folded.open = true; })")
    assert browser.fits()
    assert browser.complaints() == []


def test_injected_content_has_no_effect(browser, page, tmp_path):
    """Beside the escaping: a script, style or picture that got into the page nevertheless would
    have no effect."""
    injected = (
        "<script>document.title = 'owned'</script><img src='x' onerror=\"document.title ="
        " 'owned'\"><img src='https://example.invalid/a.png'><style>body { display: none"
        " }</style></main>"
    )
    path = tmp_path / "injected.html"
    path.write_text(page.read_text().replace("</main>", injected))
    browser.open(path)
    assert browser.run("document.title") == "Is a plain text right?"
    assert browser.run("getComputedStyle(document.body).display") == "block"
    assert len([c for c in browser.complaints() if "Content Security Policy" in str(c)]) >= 3


def test_sorts_numbers_as_numbers_and_back(browser, page):
    browser.open(page)
    rows = ROW_NAMES[6:]
    up = ["a plain text", "other", "published", *rows, "saltation", "branching", "corrected"]
    down = ["branching", "saltation", "published", *rows, "other", "a plain text", "corrected"]
    click = f"{SPEED}.querySelector('button').click(); {SPEED}.getAttribute('aria-sort')"
    for sense, names in (("ascending", up), ("descending", down), (None, ROW_NAMES)):
        assert browser.run(click) == sense
        assert browser.run(COLUMN.format(0)) == names


def test_sorts_words_from_the_keyboard(browser, page):
    browser.open(page)
    browser.run("document.querySelector('section table th button').focus()")
    browser.press("Enter", 13)
    assert browser.run(COLUMN.format(0)) == sorted(ROW_NAMES)
    assert browser.run("document.querySelectorAll('[aria-sort]').length") == 1


FILTER = """(() => {{
  const [box] = document.querySelectorAll('.filter input');
  box.value = '{}';
  box.dispatchEvent(new Event('input'));
  const rows = [...document.querySelectorAll('section table')[0].tBodies[0].rows];
  return [rows.filter(row => row.checkVisibility()).length,
          document.querySelector('.filter span').textContent];
}})()"""


def test_filters_in_place(browser, page):
    browser.open(page)
    # the other tables are short
    assert browser.run("document.querySelectorAll('.filter').length") == 1
    none = "No row of 12 has this word."
    for words, *shown in (("ROW 9", 6, "6 of 12 rows"), ("nothing", 0, none), ("", 12, "")):
        assert browser.run(FILTER.format(words)) == shown


def test_figures_are_enlarged_and_escape_closes(browser, page):
    browser.open(page)
    width = "document.querySelector('{} img').getBoundingClientRect().width"
    opened = "document.querySelector('dialog').open"
    assert browser.run(width.format("section figure")) == 640
    browser.run("document.querySelector('section button.enlarge').click()")
    assert browser.run(opened)
    assert browser.run(width.format("dialog")) > 1000
    assert browser.run("document.querySelector('dialog img').alt") == "Shows a plain text"
    browser.press("Escape", 27)
    assert not browser.run(opened)


COLOURS = """
const luminance = (what, of) => {
  const colour = getComputedStyle(document.querySelector(what))[of];
  const [r, g, b] = colour.match(/[0-9.]+/g).map(part => part / 255)
    .map(c => c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
};
const ground = luminance('body', 'backgroundColor');
"""
"""The luminance, 0 to 1, of a colour that the page has computed, and that of its paper."""
READABLE = """{
  const inks = ['body', 'a', 'td.good', 'td.bad', 'td.open'].map(s => luminance(s, 'color'));
  const filter = kind => getComputedStyle(
    document.querySelector(`img[src^='data:image/${kind}']`)).filter;
  [ground < 0.05, luminance('figure img', 'backgroundColor'), filter('png'), filter('svg'),
   Math.min(...inks.map(ink => (Math.max(ink, ground) + 0.05) / (Math.min(ink, ground) + 0.05)))];
}"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_every_text_is_readable_by_day_and_by_night(browser, page, scheme):
    browser.open(page, scheme=scheme)
    dark, paper, points, drawn, contrast = browser.run(COLOURS + READABLE)
    assert dark == (scheme == "dark")
    assert (paper, points) == (1.0, "none")
    assert (drawn == "none") == (scheme == "light")
    assert contrast > 4.5  # WCAG 2.2, level AA


OPENING = """{
  const [answer, table, key, contents, links] = ['.advice', 'main > .scroll', 'figure img', 'nav',
    'a[href="table.csv"]'].map(s => document.querySelector(s));
  const bottom = key.getBoundingClientRect().bottom;
  document.querySelectorAll('details').forEach(folded => { folded.open = true; });
  [answer.textContent.startsWith('For this gear pair '), bottom < 800,
   table.compareDocumentPosition(contents) === 4, links !== null,
   [...document.querySelectorAll('main .scroll')].every(
     box => box.scrollWidth <= box.clientWidth + 1)];
}"""


def test_first_screen_has_advice_and_key_figure(browser, report):
    """The contents follow the table, which is linked; no table is cut at 1280 pixels."""
    browser.open(report, height=800)
    assert browser.run(OPENING) == [True] * 5


def test_long_folded_tables_are_not_printed_and_say_so(browser, tmp_path):
    table = Table.of(["a"], [[f"row {i}"] for i in range(60)])
    report = Report("report", "t", ("a",), RECORD, {"rows": table}, template="long.j2")
    write_page(report, tmp_path)
    browser.open(tmp_path / "report.html", 794, medium="print")
    assert not browser.run("document.querySelector('details table').checkVisibility()")
    said = "getComputedStyle(document.querySelector('summary'), '::after').content"
    assert "not printed" in browser.run(said)


def test_print_is_light_opens_everything_and_has_no_controls(browser, page):
    browser.open(page, 794, scheme="dark", medium="print")
    assert browser.run(f"{COLOURS}ground") == 1.0
    height = "document.querySelector('details table').getBoundingClientRect().height"
    assert browser.run(height) > 20
    seen = "['nav', '.filter', 'dialog'].some(s => document.querySelector(s).checkVisibility())"
    assert not browser.run(seen)


def test_reads_without_scripts(browser, page):
    browser.call("Emulation.setScriptExecutionDisabled", value=True)
    try:
        browser.open(page)
        seen = "['section table', 'dialog'].map(s => document.querySelector(s).checkVisibility())"
        assert browser.run(seen) == [True, False]
        controls = "document.querySelectorAll('th button, .filter, button.enlarge').length"
        assert browser.run(controls) == 0
    finally:
        browser.call("Emulation.setScriptExecutionDisabled", value=False)
