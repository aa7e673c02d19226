"""Files are treated as data, names are not interpreted, and no connection is opened."""

import ast
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
SOURCES = [path for package in ("scene", "closure", "montecarlo", "compare") for path in (ROOT / package).rglob("*.py")]
RUNS_CODE = {"pickle", "cPickle", "dill", "cloudpickle", "joblib", "marshal", "shelve", "yaml", "runpy", "code"}
CLUSTERS = {"distributed", "asyncio"}
CALLS_OUT = {"socket", "ssl", "http", "urllib", "requests", "httpx", "ftplib", "smtplib", "tornado", *CLUSTERS}
NAMES = {"eval", "exec", "compile", "__import__", "system", "popen", "read_pickle", "to_pickle", "Popen"}
SMALL = ["--paths", "64", "--impacts", "1", "--dt", "0.01", "--no-validity", "--closure", "corrected", "--sigma", "0.1"]


def offences(path, source):
    """Imports and calls in a source that run code from data, or open a shell or a connection."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            modules = [node.module or ""] if isinstance(node, ast.ImportFrom) else [alias.name for alias in node.names]
            for module in {m.split(".")[0] for m in modules} & (RUNS_CODE | CALLS_OUT):
                asked_for = module in CLUSTERS and path.name in ("cluster.py", "connection.py")
                ours = module == "pickle" and path.name == "compiled.py"  # numba's files, in a private folder
                if not (asked_for or ours):
                    yield f"imports {module}"
        elif isinstance(node, ast.Call):
            name = getattr(node.func, "attr", getattr(node.func, "id", ""))
            of = getattr(getattr(node.func, "value", None), "id", "")
            called = ast.unparse(node.func)
            given_on = {k.arg for k in node.keywords if not (isinstance(k.value, ast.Constant) and not k.value.value)}
            if name in NAMES and called not in ("re.compile", "super().compile"):  # the latter is numba's
                yield f"calls {name}"
            if given_on & {"shell", "allow_pickle"}:
                yield "opens a shell or a pickle"
            if (of, name) == ("np", "load") or (name == "CDLL" and ast.unparse(node.args[0]) != "None"):
                yield f"calls {of}.{name}"


def test_nothing_runs_what_it_reads():
    assert [(str(path), *offences(path, path.read_text(encoding="utf-8"))) for path in SOURCES] == [
        (str(path),) for path in SOURCES
    ]


@pytest.mark.parametrize(
    "source",
    ["import pickle", "from marshal import loads", "eval(x)", "pd.read_pickle(x)", "np.load(x, allow_pickle=True)",
     "np.load(x)", "run(x, shell=True)", "os.system(x)", "import urllib.request", "from distributed import Client",
     "yaml.load(x); import yaml", "ctypes.CDLL(name)", "compile(x, y, z)"],
)  # fmt: skip
def test_what_would_run_it_is_seen(source):
    assert list(offences(Path("x.py"), source))


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
