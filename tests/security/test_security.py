"""Files are treated as data, names are not interpreted, and no connection is opened."""

import json
import re
import socket
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from commands import rattle, study
from hypothesis import given, settings
from hypothesis import strategies as st
from programs import python

from rattle.compare.report.folder import default_place
from rattle.compare.report.json_text import read_page
from rattle.compare.thresholds.fixture import baseline_path
from rattle.scene import DAT21, Scene

ROOT = Path(__file__).resolve().parents[2]
SMALL = ["--paths", "64", "--impacts", "1", "--dt", "0.01", "--no-validity", "--closure", "corrected", "--sigma", "0.1"]


def test_every_dependency_is_pinned_by_name_and_hash():
    for pin in (ROOT / "requirements.txt").read_text().replace(" \\\n    ", " ").splitlines():
        assert re.fullmatch(r"[A-Za-z0-9_.-]+==[A-Za-z0-9.]+( --hash=sha256:[0-9a-f]{64})+", pin)


NASTY = "a\"'<script>alert(1)<$\\frac{&`_*[x](y)|# \x1b[31m%s{0}…"


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


@pytest.mark.usefixtures("undrawn")
def test_a_hostile_name_in_a_report(tmp_path, monkeypatch):
    """The name of a scene file, with bytes that are no text, in figures, page and manifest."""
    monkeypatch.chdir(tmp_path)
    scene = tmp_path / (NASTY.replace("/", "") + "\udcff.toml")
    scene.write_text(Scene.from_gears(DAT21).to_toml())
    rattle("validate", scene, *SMALL)
    (out,) = (tmp_path / "reports").iterdir()
    html = (out / "report.html").read_text()
    assert html.count("<script") == 1
    assert "&lt;script&gt;alert(1)" in html
    assert NASTY.replace("/", "")[:9] in read_page(out / "page.json").title
    assert "\x1b" not in (out / "report.md").read_text() + html
    for figure in (out / "figures").iterdir():
        ET.parse(figure)
    data = json.loads((out / "manifest.json").read_text())
    del data["seal"]
    data["settings"]["name"] = "../../../evil\ud800\0"
    (tmp_path / "m.json").write_text(json.dumps(data))
    before = set(tmp_path.parent.iterdir())
    rattle("validate", "--repeat", "m.json")
    (other,) = set((tmp_path / "reports").iterdir()) - {out}
    assert other.name.startswith("evil")
    assert set(tmp_path.parent.iterdir()) == before


@pytest.fixture
def alone(monkeypatch):
    """Refuses and records every attempt to open a connection."""
    calls = []

    def refuse(*given_to, **_):
        calls.append(given_to)
        raise ConnectionRefusedError("no command may call out")

    for name in ("connect", "connect_ex", "sendto", "bind"):
        monkeypatch.setattr(socket.socket, name, refuse)
    for name in ("create_connection", "getaddrinfo", "gethostbyname"):
        monkeypatch.setattr(socket, name, refuse)
    return calls


def test_no_command_opens_a_connection(alone, tmp_path):
    commands = [
        ["validate", *SMALL, "--out", tmp_path / "report"],
        ["show", tmp_path / "report"],
        ["simulate", "--paths", "64", "--impacts", "1"],
        ["order", "--impacts", "1", "--paths", "64"],
        ["check", "published", "--result", "bouncing-ball"],
    ]
    for command in commands:
        rattle(*command)
    assert alone == []
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", 9))
    assert len(alone) == 1


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
