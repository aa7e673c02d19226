"""Data flows scene -> closure | montecarlo -> compare, never back; and importing stays cheap."""

import ast

import pytest
from places import ROOT
from programs import python
from source_tree import circles, import_graph, rooms, sources

MAY_IMPORT = {
    "scene": {"scene"},
    "closure": {"scene", "closure"},
    "montecarlo": {"scene", "montecarlo"},
    "compare": {"scene", "closure", "montecarlo", "compare"},
}


def names_of(path):
    """The first parts of the names of the modules that a source imports."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add(str(node.module).partition(".")[0])
    return found


@pytest.mark.parametrize("package", [*MAY_IMPORT, "tests"])
def test_packages_are_imported_by_one_name(package):
    """``import scene`` would make a second module of the same file; and click is imported in the
    command line alone."""
    for path in (ROOT / package).rglob("*.py"):
        names = names_of(path)
        assert not names & set(MAY_IMPORT), path
        assert "click" not in names or package == "tests" or path.parent.name == "cli", path


@pytest.fixture(scope="module")
def trees():
    return sources()


def test_imports_go_in_one_direction(trees):
    """And nothing rests on the command line."""
    for name, targets in import_graph(trees).items():
        assert {t.partition(".")[0] for t in targets} <= MAY_IMPORT[name.partition(".")[0]], name
        assert not [
            target for target in targets if target.startswith("compare.cli")
        ] or name.startswith("compare.cli"), name


@pytest.mark.parametrize("name", ["rattle.compare.cli.main", "rattle"])
def test_neither_help_nor_the_import_loads_the_scientific_stack(name):
    code = f"import sys, {name}; print({{'numba', 'pandas', 'matplotlib'}} & sys.modules.keys())"
    assert python("-c", code).stdout.strip() == "set()"


def test_no_imports_run_in_a_circle(trees):
    """Wherever they stand: at the top of a module, for types only, or within a function."""
    assert not circles(import_graph(trees))
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}) == [
        {"a", "b", "c"}
    ]  # one that is planted


@pytest.mark.parametrize("package", ["closure", "montecarlo", "compare"])
def test_folders_import_each_other_one_way(trees, package):
    assert not circles(rooms(import_graph(trees), package))
