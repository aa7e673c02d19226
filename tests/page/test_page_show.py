"""``rattle show``, as a user meets it."""

import json
from functools import partial

import pytest
from commands import rattle
from sample_page import figures, sample

from rattle.compare.report.render import write_page

show = partial(rattle, "show")


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = figures(tmp_path_factory.mktemp("reports") / "r")
    write_page(sample(), folder, "report")
    return folder


def test_shows_the_answer_first_and_what_repeats_it_last(report):
    shown = show(report).stdout
    order = ["Is a plain text right?", "Yes: a plain text.", "[b.png] A point.", "First a plain", "rattle validate"]
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
    assert max(map(len, show(report, "--width", 60, "--section", "inner").stdout.splitlines())) <= 60
    assert "width = 3: must be at least 20" in show(report, "--width", 3, code=2).stderr


def test_what_is_no_report(report, tmp_path):
    assert "holds no page.json" in show(tmp_path, code=2).stderr
    assert "cannot be read" in show(tmp_path / "nowhere", code=2).stderr
    data = json.loads((report / "page.json").read_text())
    (tmp_path / "page.json").write_text(json.dumps(data | {"version": 9, "page": {"new": True}}))
    assert "newer version" in show(tmp_path, code=2).stderr
