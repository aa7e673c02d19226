"""The wheel: one import name, beside any project's own modules, a command and a plugin."""

import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from importlib import metadata

import pytest
from places import ROOT


def run(*command, cwd, code=0):
    done = subprocess.run(
        [str(part) for part in command], cwd=cwd, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == code, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def copied(tmp_path_factory):
    """A copy of what git tracks, without links, so that the tree stays as it is."""
    copy = tmp_path_factory.mktemp("copy")
    tracked = ("git", "ls-files", "--cached", "--others", "--exclude-standard")
    for name in run(*tracked, cwd=ROOT).splitlines():
        if name.startswith(("reports/", "tests/")) or not (ROOT / name).exists():
            continue
        assert not (ROOT / name).is_symlink(), f"{name}: a clone on Windows or a zip loses links"
        target = copy / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes((ROOT / name).read_bytes())
    return copy


def build(source, out):
    """The wheel of a source tree."""
    words = "-m pip wheel --quiet --no-deps --no-build-isolation -w"
    run(sys.executable, *words.split(), out, source, cwd=out)
    (built,) = out.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def wheel(copied, tmp_path_factory):
    return build(copied, tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """Python of an environment that has the wheel and, through a path file, this one's
    libraries."""
    home = tmp_path_factory.mktemp("environment")
    run(sys.executable, "-m", "venv", "--without-pip", home, cwd=home)
    (site,) = home.glob("lib/python*/site-packages")
    install = "-m pip install --quiet --no-deps --target"
    run(sys.executable, *install.split(), site, wheel, cwd=home)
    (site / "libraries.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return home / "bin/python"


SOURCE_FOLDERS = ("scene", "closure", "montecarlo", "compare", "src")


def plain(name):
    """The name of a distribution as an index writes it."""
    return re.sub("[-_.]+", "-", name).lower()


def undeclared(declared):
    """Libraries that the source imports and that no requirement names."""
    source = "".join(
        path.read_text() for top in SOURCE_FOLDERS for path in (ROOT / top).rglob("*.py")
    )
    imported = {*re.findall(r"(?m)^ *(?:from|import) (\w+)", source)}
    known = metadata.packages_distributions()
    names = {plain(name) for name in declared}
    others = {"rattle", "pytest", "xarray", "distributed"}  # of the plugin, and of extras
    libraries = (imported & known.keys()) - others
    return {library for library in libraries if not names & set(map(plain, known[library]))}


def test_every_library_that_is_imported_is_declared():
    """Tests run beside the libraries of the documentation, which would hide one that is missing."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    declared = [re.match(r"[\w.-]+", text)[0] for text in project["dependencies"]]
    assert undeclared(declared) == set()
    assert undeclared([name for name in declared if name != "lazy-loader"]) == {"lazy_loader"}


BESIDE_OURS = """
import sys
import closure, compare, montecarlo, scene
import rattle

def test_both():
    for module in (scene, closure, montecarlo, compare):
        assert module.mine == module.__name__
    assert rattle.Scene.__module__ == "rattle.scene.scene"
    assert rattle.__file__.startswith(sys.prefix)
"""


@pytest.mark.slow
def test_wheel_holds_one_import_name(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    assert not [name for name in names if not re.match(r"rattle(-[^/]*\.dist-info)?/", name)]
    modules = [path for top in SOURCE_FOLDERS[:4] for path in (ROOT / top).rglob("*.py")]
    assert {f"rattle/{path.relative_to(ROOT)}" for path in modules} <= names
    assert "rattle/py.typed" in names
    assert any(name.startswith("rattle/compare/report/templates/") for name in names)
    assert any(name.endswith("licenses/LICENSE") for name in names)


@pytest.mark.slow
def test_wheel_of_the_source_archive_is_the_same(wheel, copied, tmp_path):
    code = "import sys; from setuptools.build_meta import build_sdist; build_sdist(sys.argv[1])"
    run(sys.executable, "-c", code, tmp_path, cwd=copied)
    (archive,) = tmp_path.glob("*.tar.gz")
    shutil.unpack_archive(archive, tmp_path, filter="data")
    again = build(tmp_path / archive.name.removesuffix(".tar.gz"), tmp_path)
    assert sorted(zipfile.ZipFile(again).namelist()) == sorted(zipfile.ZipFile(wheel).namelist())


@pytest.mark.slow
def test_wheel_offers_its_command_and_its_plugin_beside_modules_of_the_same_names(
    installed, tmp_path
):
    """In a project with modules called as our folders are."""
    for name in SOURCE_FOLDERS[:4]:
        (tmp_path / f"{name}.py").write_text(f"mine = '{name}'\n")
    (tmp_path / "test_mine.py").write_text(BESIDE_OURS)
    words = "-m pytest -q -p no:cacheprovider --rattle-seed 3"
    assert "1 passed" in run(installed, *words.split(), cwd=tmp_path)
    (command,) = installed.parent.parent.glob("lib/python*/site-packages/bin/rattle")
    # pip has written the python that it ran in
    run("sed", "-i", f"1s|.*|#!{installed}|", command, cwd=tmp_path)
    assert "Usage" in run(command, "--help", cwd=tmp_path)
