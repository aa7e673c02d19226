"""Terms of a page's glossary show their meaning where they stand: on hover, from the keyboard, and
on a tap."""

import re

import pytest
from sample_page import RECORD, figures

from rattle.compare.report.render import Terms, as_html, write_page
from rattle.compare.report.report import Report
from rattle.compare.report.table import Table, of_numbers
from rattle.compare.report.texts import glossary

GLOSSARY = (
    ("`published`", "as printed"),
    ("x1, x2", "position <b>"),
    ("σ", "noise"),
    ("E, sd", "spread"),
)
MARKED = re.compile(r'<abbr title="([^":]*)[^>]*>(.*?)</abbr>')


def test_words_are_marked_once_in_a_text_and_names_only_in_code():
    text = "`published` results, published: sds of x1 and x1, not ax1 or x1-x2, at σ"
    assert MARKED.findall(str(as_html(text, words=Terms(GLOSSARY).text))) == [
        ("published", "published"),
        ("E, sd", "sds"),
        ("x1, x2", "x1"),
        ("σ", "σ"),
    ]


@pytest.fixture(scope="module")
def shown(tmp_path_factory, browser):
    folder = tmp_path_factory.mktemp("terms")
    heads = ["closure", of_numbers("E τ"), of_numbers("sd y1")]
    table = Table.of(heads, [["saltation", 0.1, 0.2], ["published", 0.3, 0.4]])
    words = glossary("closures", "sections", "verdicts", "σ")
    answer = ("Take `saltation` up to σ = 0.1.",)
    report = Report("report", "t", answer, RECORD, {"rows": table}, words, template="terms.j2")
    write_page(report, figures(folder))
    return browser, folder / "report.html"


FOCUSED = "(document.activeElement.closest('abbr') ?? document.activeElement.querySelector('abbr'))"
POPUP = f"getComputedStyle({FOCUSED}, '::after')"
CELL = (
    "(() => { const at = document.querySelector('td abbr').getBoundingClientRect(); return [at.x +"
    " 5, at.y + 5]; })()"
)


@pytest.mark.parametrize("width", [1280, 390])
def test_the_meaning_opens_on_hover_on_focus_and_on_a_tap(shown, width):
    browser, path = shown
    browser.open(path, width)
    assert "follows small deviations" in browser.run("document.querySelector('.advice abbr').title")
    browser.press("Tab", 9)
    assert browser.run("document.activeElement.textContent") == "saltation"
    assert "follows small deviations" in browser.run(f"{POPUP}.content")
    assert browser.run(f"{POPUP}.position") == "fixed"
    browser.run("document.activeElement.blur()")
    x, y = browser.run(CELL)
    for kind in ("mousePressed", "mouseReleased"):
        browser.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)
    assert browser.run("document.activeElement.matches('td abbr')")
    assert "follows small deviations" in browser.run(f"{POPUP}.content")


def test_the_head_of_a_column_sorts_and_explains(shown):
    browser, path = shown
    browser.open(path)
    browser.run("document.querySelectorAll('th button')[2].focus()")
    assert "standard deviation" in browser.run(f"{POPUP}.content")
    assert "velocities" in browser.run(f"{POPUP}.content")
    # the button is what is reached
    assert browser.run("document.querySelectorAll('th [tabindex]').length") == 0
    browser.press("Enter", 13)
    assert browser.run("document.querySelectorAll('[aria-sort]').length") == 1
