"""A page as a file: what is written is read back, and anything else is refused."""

import json
from functools import reduce
from operator import getitem

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sample_page import NASTY, sample

from rattle.compare.report import Column, Page, PageSection, Source, Table, TableCell, Text, leading_number, numbers
from rattle.compare.report.json_text import page_text, read_page
from rattle.scene import FileError


@pytest.mark.parametrize("text", ["a plain text", NASTY])
def test_what_is_written_is_read(tmp_path, text):
    (tmp_path / "page.json").write_text(page_text(sample(text)))
    assert read_page(tmp_path / "page.json") == sample(text)


@settings(max_examples=60, deadline=None)
@given(st.text(), st.floats(allow_nan=False, allow_infinity=False), st.lists(st.text()))
def test_any_text_and_number_is_read_back(tmp_path_factory, text, value, titles):
    table = Table((Column(text),), ((TableCell(text, "open", value),),))
    page = Page(text, (text,), Source(text), (table,), tuple(PageSection(t, (Text(text),)) for t in titles))
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


@pytest.mark.parametrize("content", [b"", b"[1", b"[]", b"null", b'"rattle page"', b"[" * 100_000, b"\xff\xfe\x00"])
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
    assert [leading_number(t) for t in ("below 0.5", "+3e-4 ✓", "0.001 – 2", "no")] == [0.5, 3e-4, 0.001, None]
