"""An output folder is written whole or not at all, and no file of others is lost."""

import pytest

from rattle.compare.report.folder import check_free, whole_folder
from rattle.scene import OutputError

OURS = frozenset({"page.txt"})


def contents(folder):
    return sorted(p.name for p in folder.iterdir())


def test_writes_and_replaces_only_on_request(tmp_path):
    out = tmp_path / "deep" / "report"
    with whole_folder(out, OURS, overwrite=False) as folder:
        (folder / "page.txt").write_text("one")
    with pytest.raises(OutputError, match="--overwrite"):
        check_free(out, OURS, overwrite=False)
    with whole_folder(out, OURS, overwrite=True) as folder:
        (folder / "page.txt").write_text("two")
    assert (out / "page.txt").read_text() == "two"
    assert contents(out.parent) == ["report"]


def test_failure_leaves_the_old_report(tmp_path):
    out = tmp_path / "report"
    with whole_folder(out, OURS, overwrite=False) as folder:
        (folder / "page.txt").write_text("old")

    def fail_half_way():
        with whole_folder(out, OURS, overwrite=True) as folder:
            (folder / "page.txt").write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail_half_way()
    assert (out / "page.txt").read_text() == "old"
    assert contents(tmp_path) == ["report"]


def test_foreign_things_are_never_touched(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(OutputError, match=r"thesis\.tex"):
        check_free(tmp_path, OURS, overwrite=True)


def test_a_file_in_the_way(tmp_path):
    (tmp_path / "report").write_text("")
    with pytest.raises(OutputError, match="not a folder"):
        check_free(tmp_path / "report", OURS, overwrite=True)


def test_an_empty_folder_may_be_used(tmp_path):
    check_free(tmp_path, OURS, overwrite=False)
