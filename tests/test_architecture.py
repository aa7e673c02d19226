"""Data flows scene -> closure | montecarlo -> compare, never back; and importing stays cheap."""

import ast
from collections import Counter
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest
from programs import python
from source_tree import circles, floors, import_graph, rooms, sources

ROOT = Path(__file__).resolve().parent.parent
MAY_IMPORT = {
    "scene": {"scene"},
    "closure": {"scene", "closure"},
    "montecarlo": {"scene", "montecarlo"},
    "compare": {"scene", "closure", "montecarlo", "compare"},
}


def modules(path: Path) -> Iterator[str]:
    """Full names of the modules that a source imports."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (
                [f"rattle.{alias.name}" for alias in node.names]
                if node.module == "rattle"
                else [node.module]
            )


def packages(path: Path) -> set[str]:
    """Our packages that a source imports."""
    return {name.split(".")[1] for name in modules(path) if name.startswith("rattle.")}


@pytest.mark.parametrize("package", [*MAY_IMPORT, "tests"])
def test_imports(package):
    """In one direction, by the one name (``import scene`` would make a second module of the same
    file), and click in the command line alone, on which nothing rests."""
    for path in (ROOT / package).rglob("*.py"):
        names = set(modules(path))
        assert not {name.split(".")[0] for name in names} & set(MAY_IMPORT), path
        if package == "tests":
            continue
        assert packages(path) <= MAY_IMPORT[package], path
        if path.parent.name != "cli":
            assert "click" not in {name.split(".")[0] for name in names}, path
            assert not any(name.startswith("rattle.compare.cli") for name in names), path


@pytest.mark.parametrize("package", ["", *(f".{name}" for name in MAY_IMPORT)])
def test_public_names_exist(package):
    module = import_module(f"rattle{package}")
    for name in getattr(module, "__all__", ()):
        assert hasattr(module, name)


HEAVY = "; print([m for m in ('numba', 'pandas', 'matplotlib') if m in sys.modules])"


@pytest.mark.parametrize("name", ["rattle.compare.cli.main", "rattle"])
def test_neither_help_nor_the_import_loads_the_scientific_stack(name):
    assert python("-c", f"import sys, {name}{HEAVY}").stdout.strip() == "[]"


@pytest.fixture(scope="module")
def trees():
    return sources()


def test_a_class_name_has_one_meaning(trees):
    nodes = (node for tree in trees.values() for node in ast.walk(tree))
    names = Counter(node.name for node in nodes if isinstance(node, ast.ClassDef))
    assert not [name for name, times in names.items() if times > 1]


def test_no_imports_run_in_a_circle(trees):
    """Wherever they stand: at the top of a module, for types only, or within a function."""
    assert not circles(import_graph(trees))
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}) == [
        {"a", "b", "c"}
    ]  # one that is planted


@pytest.mark.parametrize(("package", "most"), {"closure": 5, "montecarlo": 7, "compare": 8}.items())
def test_folders_import_each_other_one_way_on_few_floors(trees, package, most):
    found = rooms(import_graph(trees), package)
    assert not circles(found)
    assert floors(found) <= most
    assert floors({"a": {"b"}, "b": {"c"}, "c": set(), "d": {"c"}}) == 3
