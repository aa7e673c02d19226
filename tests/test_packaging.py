"""The wheel: one import name, beside any project's own modules, for pytest and for mypy."""

import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


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
    return home / "bin" / "python"


@pytest.fixture
def neighbour(tmp_path):
    """A project with modules called as our folders are."""
    for name in ("scene", "closure", "montecarlo", "compare"):
        (tmp_path / f"{name}.py").write_text(f"mine = {name!r}\n")
    (tmp_path / "test_mine.py").write_text(
        "import closure, compare, montecarlo, scene\nimport rattle\n\n"
        "def test_both():\n"
        "    assert (scene.mine, closure.mine, montecarlo.mine, compare.mine) == "
        "('scene', 'closure', 'montecarlo', 'compare')\n"
        "    assert rattle.Scene.__module__ == 'rattle.scene.scene'\n"
    )
    return tmp_path


@pytest.mark.slow
def test_wheel_holds_one_import_name(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    top = {name.split("/")[0] for name in names}
    assert {name for name in top if not name.endswith(".dist-info")} == {"rattle"}
    modules = {
        str(path.relative_to(ROOT))
        for top in ("scene", "closure", "montecarlo", "compare")
        for path in (ROOT / top).rglob("*.py")
    }
    assert {f"rattle/{path}" for path in modules} <= set(names)
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
    names = zipfile.ZipFile(wheel).namelist()
    assert sorted(zipfile.ZipFile(again).namelist()) == sorted(names)


@pytest.mark.slow
def test_wheel_beside_modules_of_the_same_names(installed, neighbour):
    code = "import sys, rattle, scene, compare; print(rattle.__file__, scene.mine, compare.mine)"
    file, *mine = run(installed, "-c", code, cwd=neighbour).split()
    assert Path(file).is_relative_to(installed.parent.parent)
    assert mine == ["scene", "compare"]
    pytest_words = "-m pytest -q -p no:cacheprovider"
    assert "1 passed" in run(installed, *pytest_words.split(), cwd=neighbour)


@pytest.mark.slow
def test_wheel_offers_command_and_plugin(installed, neighbour):
    (command,) = installed.parent.parent.glob("lib/python*/site-packages/bin/rattle")
    # pip has written the python that it ran in
    run("sed", "-i", f"1s|.*|#!{installed}|", command, cwd=neighbour)
    assert "Usage" in run(command, "--help", cwd=neighbour)
    assert "--rattle-seed" in run(installed, "-m", "pytest", "--help", cwd=neighbour)


def test_no_module_under_two_names():
    code = (
        "import sys, pkgutil, importlib, pathlib, rattle\n"
        "for m in pkgutil.walk_packages(rattle.__path__, 'rattle.'):\n"
        "    if not m.name.endswith('__main__'):\n"
        "        importlib.import_module(m.name)\n"
        "files = [str(pathlib.Path(m.__file__).resolve()) for n, m in list(sys.modules.items())\n"
        "         if getattr(m, '__file__', None) and n.split('.')[0] in\n"
        "         ('rattle', 'scene', 'closure', 'montecarlo', 'compare')]\n"
        "print(len(files) > 100, len(files) - len(set(files)))"
    )
    assert run(sys.executable, "-c", code, cwd=ROOT).split() == ["True", "0"]


@pytest.mark.slow
def test_mypy_knows_the_types_of_the_installed_package(installed, neighbour):
    if (ROOT / ".mypy_cache").is_dir():  # what mypy knows of the libraries already
        shutil.copytree(ROOT / ".mypy_cache", neighbour / "cache")
    user = neighbour / "user.py"
    user.write_text(
        "import rattle as rt\n\n\ndef worst(sigma: float) -> float:\n"
        "    scene = rt.Scene.from_gears(rt.DAT21, sigma=sigma)\n"
        "    section = rt.mean_map(scene, impacts=2).section\n"
        "    return float(section['sd_y1'].max())\n"
    )
    words = [installed, *["-m", "mypy", "--strict", "--cache-dir", "cache", "user.py"]]
    run(*words, cwd=neighbour)
    user.write_text(user.read_text().replace("impacts=2", "impacts='two'"))
    assert 'has incompatible type "str"' in run(*words, cwd=neighbour, code=1)
