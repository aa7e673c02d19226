"""HTML, Markdown and terminal show the same content, and no text from a scene is interpreted as
markup."""

import re
from html.parser import HTMLParser

import click
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from sample_page import NASTY, figures, sample

from rattle.compare.cli.terminal import read_sections
from rattle.compare.report.render import html, markdown
from rattle.compare.report.table import SIGNS_OF_MARKS
from rattle.scene import line


class Read(HTMLParser):
    """The tags of an HTML file with the names of their attributes, and the text that a reader
    sees."""

    def __init__(self, text):
        super().__init__()
        self.tags = []
        self.text = ""
        self._hidden = False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, tuple(name for name, _ in attrs)))
        self._hidden = tag in ("style", "script")

    def handle_endtag(self, tag):
        self.tags.append(tag)
        self._hidden = False

    def handle_data(self, data):
        self.text += "" if self._hidden else data


def terminal(page, folder, width=100_000):
    """The lines of a page on a terminal, without colours."""
    sections = read_sections(markdown(page, folder))
    return [click.unstyle(row) for one in sections for row in one.lines(width)]


def squeezed(text):
    return re.sub(r"\s+", "", text)


def said(report):
    """Every text of a page, as a reader should see it."""
    text = report.content["text"]
    for table in (report.content["speeds"], report.content["wide"]):
        yield from (column.head for column in table.columns)
        yield from (cell.text + SIGNS_OF_MARKS[cell.mark] for row in table.rows for cell in row)
    facts = {"command": "`rattle`", "commit": "abc", "time": "1.0 s wall", **report.more}
    for pair in (*facts.items(), *report.words):
        yield from pair
    yield from (report.title, *report.answer, report.repeat, "A point.", "```\na\n```", "Inner")
    yield from (f"{word} {text}" for word in ("First", "Before", "Under", "Folded", "Again"))
    yield f"x = '{text}'"


def bare(markdown_text):
    """Markdown without its markup: escapes and code marks."""
    return re.sub(r"\\([!-/:-@[-`{-~])|(?<!\\)`", r"\1", markdown_text)


@pytest.mark.parametrize("text", ["a plain text", NASTY])
def test_all_three_views_say_everything(text, tmp_path):
    page = sample(text)
    folder = figures(tmp_path)
    views = {
        "html": Read(html(page, folder)).text,
        "markdown": bare(markdown(page, folder)),
        "terminal": "\n".join(terminal(page, folder)),
    }
    for view, shown in views.items():
        seen = squeezed(shown).replace("`", "")
        for words in said(page):
            assert squeezed(line(words)).replace("`", "") in seen, (view, words)


def tags(text, folder):
    """The tags of the sample except those of code, which a text may contain between backticks."""
    read = Read(html(sample(text), folder))
    return [tag for tag in read.tags if tag not in (("code", ()), "code")]


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    return figures(tmp_path_factory.mktemp("drawn") / "r")


@settings(max_examples=20, deadline=None)
@example(NASTY)
@given(st.text(min_size=1) | st.text("<>&'\"`/!-= aimgonx[]", min_size=1))
def test_html_has_the_same_tags_whatever_the_texts(drawn, text):
    # these are explained where they stand, by an element of their own
    assume(not re.search("σ|other", text))
    plain = tags("a plain text", drawn)
    assert [tag[0] for tag in plain].count("script") == 1
    assert tags(text, drawn) == plain


def test_tables_beside_a_page_are_links_and_nothing_else_is(tmp_path):
    folder = figures(tmp_path)
    for name in ("rows.csv", "a b.csv", "x&y.csv", "notes.txt"):
        (folder / name).write_text("a\n1\n")
    page = sample("see `rows.csv`, `a b.csv`, `x&y.csv`, `gone.csv` and `notes.txt`")
    assert set(re.findall(r'href="([^"#]+)"', html(page, folder))) == {"rows.csv"}
    assert "[`rows.csv`](rows.csv)" in markdown(page, folder)
    (folder / "rows.csv").unlink()
    assert "](" not in re.sub(r"!\[[^\n]*", "", markdown(page, folder))


def test_links_of_the_contents_lead_somewhere(tmp_path):
    text = html(sample(NASTY), figures(tmp_path))
    links = re.findall(r'href="#([^"]+)"', text)
    ids = re.findall(r'<(?!filter)[^<>]* id="([^"]+)"', text)
    assert links == ids
    assert len(set(ids)) == len(ids) == 4


@pytest.mark.parametrize("width", [20, 40, 80, 132])
def test_nothing_is_wider_than_the_terminal(width, drawn):
    rows = terminal(sample(), drawn, width)
    assert max(len(row) for row in rows if not row.startswith("    ")) <= width
