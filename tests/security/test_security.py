"""Files are treated as data, names are not interpreted, and no connection is opened."""

import re
from pathlib import Path

from commands import study
from hypothesis import given, settings
from hypothesis import strategies as st
from places import ROOT
from programs import python

from rattle.compare.report.folder import default_place
from rattle.compare.thresholds.fixture import baseline_path


def test_every_dependency_is_pinned_by_name_and_hash():
    for pin in (ROOT / "requirements.txt").read_text().replace(" \\\n    ", " ").splitlines():
        assert re.fullmatch(r"[A-Za-z0-9_.-]+==[A-Za-z0-9.]+( --hash=sha256:[0-9a-f]{64})+", pin)


@settings(max_examples=200, deadline=None)
@given(st.text(st.characters(codec=None)) | st.text("./\\~-a\0\n"))
def test_a_name_never_leaves_the_reports(name):
    path = default_place(name, "-repeated")
    assert path.parent == Path("reports")
    assert path.name not in ("", ".", "..")
    assert "\0" not in path.name
    assert len(path.name.encode()) < 160


@given(st.text(st.characters(exclude_categories=("Cs",))) | st.text("./\\~-a[]\0\n"))
def test_a_baseline_lies_in_its_folder(name):
    path = baseline_path(Path("tests/test_a.py"), name)
    assert path.parent == Path("tests/baselines/test_a")
    assert "\0" not in path.name


def test_dask_is_not_even_loaded_without_a_scheduler(tmp_path):
    (tmp_path / "s.toml").write_text(study())
    code = (
        "import socket, sys\n"
        "def refuse(*a): raise SystemExit('called out')\n"
        "socket.socket.connect = refuse\n"
        "from rattle.compare.cli.main import main\n"
        "main(sys.argv[1:], standalone_mode=False)\n"
        "print([m for m in ('distributed', 'dask', 'tornado') if m in sys.modules])\n"
    )
    assert python("-c", code, "study", tmp_path / "s.toml").stdout.splitlines()[-1] == "[]"
