"""A page on the terminal, read from its Markdown."""

import math

import pytest
from commands import rattle
from hypothesis import example, given, settings
from hypothesis import strategies as st
from sample_page import NASTY, figures, sample

from rattle.compare.cli.terminal import read_sections
from rattle.compare.report.folder import linked_files, report_files
from rattle.compare.report.render import markdown, split_code, write_page
from rattle.compare.report.table import Table, leading_number, of_numbers


def bare(text):
    """A text without white space and the backticks of code."""
    return "".join("".join(piece for piece, _ in split_code(text)).split())


@settings(max_examples=30, deadline=None)
@example(NASTY)
@example("1) - # > + = a|b\\|c \\ ** __ ~~ ![x](y) &amp; `` ` ```")
@given(st.text(min_size=1) | st.text("\\`*_{}[]()<>#+-.!|~&;:=1a \n", min_size=1))
def test_markdown_is_read_as_it_was_meant(tmp_path_factory, text):
    page = sample(text)
    sections = read_sections(markdown(page, tmp_path_factory.getbasetemp()))
    titles = [page.title, f"First {text}", "Inner", f"First {text}", "Where this comes from"]
    assert ["".join(one.title.split()) for one in sections] == [bare(title) for title in titles]
    shown = "".join("".join(row.split()) for one in sections for row in one.lines(10_000))
    for words in (f"Yes: {text}.", f"means {text}", f"Before {text}", f"Again {text}"):
        assert bare(words) in shown


def test_a_text_that_looks_like_a_link_makes_no_file_ours(tmp_path):
    folder = figures(tmp_path)
    (folder / "rows.csv").touch()
    write_page(sample("[a](mine.txt) `[a](mine.txt)` ![a](mine.svg)"), folder)
    assert linked_files(folder, report_files("report")) == {"rows.csv", "b.png", "figures/a.svg"}


def test_numbers_of_cells():
    texts = {0.25: "0.25", math.nan: "–", math.inf: "inf", 1200.0: "1,200", 1e300: "1e+300"}
    table = Table.of([of_numbers("b")], [[value] for value in texts])
    assert [cell.text for (cell,) in table.rows] == [*texts.values()]
    assert [cell.value for (cell,) in table.rows] == [0.25, None, None, 1200.0, 1e300]
    texts = {"below 0.5": 0.5, "+3e-4 ✓": 3e-4, "0.001 – 2": 0.001, "no": None}
    assert {text: leading_number(text) for text in texts} == texts


def show(path, words="", **settings):
    return rattle(f"show {path} {words}", **settings)


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = figures(tmp_path_factory.mktemp("reports") / "r")
    write_page(sample(), folder)
    return folder


def test_shows_the_answer_first_and_what_repeats_it_last(report):
    shown = show(report).stdout
    order = [
        "Is a plain text right?",
        "Yes: a plain text.",
        "It holds up to",
        "[b.png]\nA point.",
        "First a plain",
        "rattle validate",
    ]
    assert sorted(order, key=shown.index) == order
    assert "\x1b" not in shown
    assert show(report / "report.md").stdout == shown
    assert "\x1b[32m" in show(report, color=True).output
    assert "\x1b" not in show(report, color=True, env={"NO_COLOR": "1"}).output


def test_one_section_in_a_width(report):
    shown = show(report, "--section inner --width 60").stdout
    assert shown.startswith("Inner")
    assert "Yes:" not in shown
    assert len(max(shown.splitlines(), key=len)) <= 60


def test_what_cannot_be_shown(report, tmp_path):
    (tmp_path / "notes.md").write_text("mine")
    (tmp_path / "empty.md").touch()
    for path, words, message in (
        (report, "--section Iner", "did you mean 'Inner'"),
        (report, "--width 3", "width = 3: must be at least 20"),
        (tmp_path, "", "holds no page"),
        (tmp_path / "nowhere", "", "cannot be read"),
    ):
        assert message in show(path, words, code=2).stderr
    assert show(tmp_path / "notes.md").stdout.strip() == "mine"
    assert show(tmp_path / "empty.md").stdout.strip() == ""
