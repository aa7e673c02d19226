"""Data flows scene -> closure | montecarlo -> compare, never back; and importing stays cheap."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
MAY_IMPORT = {
    "scene": {"scene"},
    "closure": {"scene", "closure"},
    "montecarlo": {"scene", "montecarlo"},
    "compare": {"scene", "closure", "montecarlo", "compare"},
}


def imported(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module.split(".")[0])
    return names & set(MAY_IMPORT)


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_import_direction(package):
    for path in (ROOT / package).rglob("*.py"):
        assert imported(path) <= MAY_IMPORT[package], path


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_public_names_exist(package):
    module = __import__(package)
    for name in getattr(module, "__all__", ()):
        assert hasattr(module, name)


def test_help_does_not_load_the_scientific_stack():
    code = "import sys, compare.__main__; print([m for m in ('numba', 'pandas', 'matplotlib') if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.strip() == "[]"
