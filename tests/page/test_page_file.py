"""A page as a file: what is written is read back, and anything else is refused."""

import json
from functools import partial, reduce
from operator import getitem

import pytest
from commands import rattle
from hypothesis import given, settings
from hypothesis import strategies as st
from sample_page import NASTY, figures, sample

from rattle.compare.report import (
    Column,
    Page,
    PageSection,
    Source,
    Table,
    TableCell,
    Text,
    leading_number,
    numbers,
)
from rattle.compare.report.json_text import page_text, read_page
from rattle.compare.report.render import write_page
from rattle.scene import FileError


@pytest.mark.parametrize("text", ["a plain text", NASTY])
def test_what_is_written_is_read(tmp_path, text):
    (tmp_path / "page.json").write_text(page_text(sample(text)))
    assert read_page(tmp_path / "page.json") == sample(text)


@settings(max_examples=60, deadline=None)
@given(st.text(), st.floats(allow_nan=False, allow_infinity=False), st.lists(st.text()))
def test_any_text_and_number_is_read_back(tmp_path_factory, text, value, titles):
    table = Table((Column(text),), ((TableCell(text, "open", value),),))
    page = Page(
        text, (text,), Source(text), (table,), tuple(PageSection(t, (Text(text),)) for t in titles)
    )
    path = tmp_path_factory.mktemp("p") / "page.json"
    path.write_text(page_text(page), encoding="utf-8")
    assert read_page(path) == page


def changed(place, value):
    """The data of the sample with another value somewhere."""
    data = json.loads(page_text(sample()))
    *way, last = place
    inner = reduce(getitem, way, data)
    inner[last] = value
    if value is KeyError:
        del inner[last]
    return data


BAD = {
    "newer": (("version",), 3, "newer version of rattle .page 3; this one reads 2.; update"),
    "other format": (("format",), "coffee", "is not 'rattle page'"),
    "no version": (("version",), KeyError, "no page of a report .'version'"),
    "changed": (("page", "title"), "Another", "was changed after it was written"),
    "no digest": (("sha256",), KeyError, "no page of a report .'sha256'"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_no_page_is_refused_with_its_place(case, tmp_path):
    place, value, message = BAD[case]
    (tmp_path / "page.json").write_text(json.dumps(changed(place, value)))
    with pytest.raises(FileError, match=message):
        read_page(tmp_path / "page.json")


@pytest.mark.parametrize("content", [b"", b"[1", b"[]", b"null", b'"rattle page"', b"\xff\xfe\x00"])
def test_what_is_no_object_is_refused(content, tmp_path):
    (tmp_path / "page.json").write_bytes(content)
    with pytest.raises(FileError, match=r"no page of a report|is not UTF-8 text; give a page"):
        read_page(tmp_path / "page.json")


def test_numbers_of_cells():
    values = (0.25, float("nan"), float("inf"), 1200.0, 1e300)
    table = Table.of(["a", *numbers("b")], [[str(n), value] for n, value in enumerate(values, 1)])
    assert [row[1].text for row in table.rows] == ["0.25", "–", "inf", "1,200", "1e+300"]
    assert [row[1].value for row in table.rows] == [0.25, None, None, 1200.0, 1e300]
    assert [row[0].value for row in table.rows] == [None] * 5
    assert [leading_number(t) for t in ("below 0.5", "+3e-4 ✓", "0.001 – 2", "no")] == [
        0.5,
        3e-4,
        0.001,
        None,
    ]


show = partial(rattle, "show")


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = figures(tmp_path_factory.mktemp("reports") / "r")
    write_page(sample(), folder, "report")
    return folder


def test_shows_the_answer_first_and_what_repeats_it_last(report):
    shown = show(report).stdout
    order = [
        "Is a plain text right?",
        "Yes: a plain text.",
        "[b.png] A point.",
        "First a plain",
        "rattle validate",
    ]
    assert sorted(order, key=shown.index) == order
    assert "\x1b" not in shown
    assert show(report / "page.json").stdout == shown


def test_colours_only_where_they_are_seen(report):
    assert "\x1b[32m" in show(report, color=True).output
    assert "\x1b" not in show(report, color=True, env={"NO_COLOR": "1"}).output


def test_one_section(report):
    shown = show(report, "--section", "inner", "--width", 400).stdout
    assert shown.startswith("Inner")
    assert "Yes:" not in shown
    missing = show(report, "--section", "Iner", code=2)
    assert "did you mean 'Inner'" in missing.stderr


def test_width(report):
    assert (
        max(map(len, show(report, "--width", 60, "--section", "inner").stdout.splitlines())) <= 60
    )
    assert "width = 3: must be at least 20" in show(report, "--width", 3, code=2).stderr


def test_what_is_no_report(report, tmp_path):
    assert "holds no page.json" in show(tmp_path, code=2).stderr
    assert "cannot be read" in show(tmp_path / "nowhere", code=2).stderr
    data = json.loads((report / "page.json").read_text())
    (tmp_path / "page.json").write_text(json.dumps(data | {"version": 9, "page": {"new": True}}))
    assert "newer version" in show(tmp_path, code=2).stderr
