"""The page in a real browser: loading, sorting, filtering, enlarged figures, layout, light and dark
styles."""

import pytest
from sample_page import NASTY, RECORD, Report, Table, figures, sample, write_page

COLUMN = (
    "[...document.querySelectorAll('section table')[0].rows].slice(1).map(row =>"
    " row.cells[{}].textContent)"
)
SPEED = "document.querySelectorAll('section table')[0].tHead.rows[0].cells[1]"
ROW_NAMES = ["saltation", "published", "corrected", "branching", "other", "a plain text"]
ROW_NAMES += [f"row {i}" for i in range(6)]


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = figures(tmp_path_factory.mktemp("page") / "plain")
    write_page(sample(), folder)
    return folder / "report.html"


@pytest.fixture(scope="module")
def nasty(tmp_path_factory):
    folder = figures(tmp_path_factory.mktemp("page") / "nasty")
    write_page(sample(NASTY + "long" * 60), folder)
    return folder / "report.html"


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


def test_filters_in_place(browser, page):
    browser.open(page)
    assert (
        browser.run("document.querySelectorAll('.filter').length") == 1
    )  # the other tables are short
    typed = (
        "const box = document.querySelector('.filter input'); box.value = '{}';"
        " box.dispatchEvent(new Event('input'))"
    )
    shown = (
        "[...document.querySelectorAll('section table')[0].tBodies[0].rows].filter(r =>"
        " r.checkVisibility()).length"
    )
    number_text = "document.querySelector('.filter span').textContent"
    none = "No row of 12 has this word."
    for words, rows, text in (("ROW 9", 6, "6 of 12 rows"), ("nothing", 0, none), ("", 12, "")):
        browser.run("{" + typed.format(words) + "}")
        assert browser.run(shown) == rows
        assert browser.run(number_text) == text


def test_figures_are_enlarged_and_escape_closes(browser, page):
    browser.open(page)
    width = "document.querySelector('{} img').getBoundingClientRect().width"
    assert browser.run(width.format("section figure")) == 640
    browser.run("document.querySelector('section button.enlarge').click()")
    assert browser.run("document.querySelector('dialog').open")
    assert browser.run(width.format("dialog")) > 1000
    assert browser.run("document.querySelector('dialog img').alt") == "Shows a plain text"
    browser.press("Escape", 27)
    assert not browser.run("document.querySelector('dialog').open")


def luminance(browser, what, of):
    """Luminance, 0 to 1, of a colour that the page has computed."""
    colour = browser.run(f"getComputedStyle(document.querySelector('{what}'))['{of}']")
    red, green, blue = (int(part) / 255.0 for part in colour.strip("rgba()").split(",")[:3])
    linear = [
        c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in (red, green, blue)
    ]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_every_text_is_readable_by_day_and_by_night(browser, page, scheme):
    browser.open(page, scheme=scheme)
    ground = luminance(browser, "body", "backgroundColor")
    assert (ground < 0.05) == (scheme == "dark")
    assert luminance(browser, "figure img", "backgroundColor") == 1.0
    points, drawn = (
        browser.run(
            f"getComputedStyle(document.querySelector(\"img[src^='data:image/{kind}']\")).filter"
        )
        for kind in ("png", "svg")
    )
    assert points == "none"
    assert (drawn == "none") == (scheme == "light")
    for what in ("body", "a", "td.good", "td.bad", "td.open"):
        ink = luminance(browser, what, "color")
        assert (max(ink, ground) + 0.05) / (min(ink, ground) + 0.05) > 4.5, (
            what
        )  # WCAG 2.2, level AA


def test_first_screen_has_advice_and_key_figure(browser, report):
    browser.open(report)
    browser.size(1280, 800)
    assert browser.run("document.querySelector('.advice').textContent").startswith(
        "For this gear pair "
    )
    assert browser.run("document.querySelector('figure img').getBoundingClientRect().bottom") < 800
    follows = "document.querySelector('main > .scroll').compareDocumentPosition({})"
    contents = "document.querySelector('nav')"
    assert browser.run(follows.format(contents)) == 4  # the contents follow the table
    assert browser.run("document.querySelectorAll('a[href=\"table.csv\"]').length") >= 1
    browser.run("document.querySelectorAll('details').forEach(folded => { folded.open = true; })")
    cut = "box => box.scrollWidth > box.clientWidth + 1"
    # no table is cut at 1280 pixels
    assert not browser.run(f"[...document.querySelectorAll('main .scroll')].some({cut})")


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
    assert luminance(browser, "body", "backgroundColor") == 1.0
    assert (
        browser.run("document.querySelector('details table').getBoundingClientRect().height") > 20
    )
    assert not browser.run(
        "['nav', '.filter', 'dialog'].some(s => document.querySelector(s).checkVisibility())"
    )


def test_reads_without_scripts(browser, page):
    browser.call("Emulation.setScriptExecutionDisabled", value=True)
    try:
        browser.open(page)
        assert not browser.run(
            "document.querySelectorAll('th button, .filter, button.enlarge').length"
        )
        assert browser.run("document.querySelector('section table').checkVisibility()")
        assert not browser.run("document.querySelector('dialog').checkVisibility()")
    finally:
        browser.call("Emulation.setScriptExecutionDisabled", value=False)
