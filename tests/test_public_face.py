"""What is public is complete: `rattle.__all__`, the reference and the guide name the same, each
with a full text."""

import inspect
import re
from importlib import import_module

import pytest
from places import ROOT

import rattle

GUIDE_PAGES = [
    ROOT / "README.md",
    ROOT / "docs" / "start.md",
    *sorted((ROOT / "docs" / "guide").glob("*.md")),
]
CALLED = [name for name in rattle.__all__ if inspect.isfunction(getattr(rattle, name))]
CLASSES = [name for name in rattle.__all__ if inspect.isclass(getattr(rattle, name))]
ERRORS = [name for name in CLASSES if issubclass(getattr(rattle, name), Exception)]


def blocks(page):
    """The blocks of Python of a page."""
    return re.findall(
        r"^```(?:python|\{code-cell\})\n(.*?)^```", page.read_text(), flags=re.M | re.S
    )


FACES = ("scene", "closure", "montecarlo", "compare")


def test_the_reference_has_the_public_names_where_they_are_imported_from():
    pages = "".join(page.read_text() for page in (ROOT / "docs" / "reference").glob("api-*.md"))
    entries = re.findall(r"^   ([a-z_]+\.[\w.]+)$", pages, flags=re.M)
    names = {entry.rpartition(".")[2]: entry for entry in entries}
    assert names.keys() >= set(rattle.__all__)
    for name, entry in names.items():
        place = import_module(f"rattle.{entry.rpartition('.')[0]}")
        package = import_module(f"rattle.{entry.partition('.')[0]}")
        if name in rattle.__all__:
            assert getattr(place, name) is getattr(rattle, name), entry
        elif package.__name__ != "rattle.scene":  # which loads neither numba nor what needs it
            assert getattr(place, name) is getattr(package, name), entry


@pytest.mark.parametrize("page", GUIDE_PAGES, ids=lambda page: page.name)
def test_the_guide_needs_nothing_else(page):
    for code in blocks(page):
        imported = re.findall(r"^\s*(?:from|import) (rattle\.\S+)", code, flags=re.M)
        assert {*imported} <= {f"rattle.{package}" for package in FACES}
        assert {*re.findall(r"\brt\.(\w+)", code)} <= {*rattle.__all__, "__version__"}


@pytest.mark.parametrize("name", [*CALLED, *(name for name in CLASSES if name not in ERRORS)])
def test_what_is_public_has_a_full_text(name):
    """With an example, which the doctests run."""
    text = inspect.getdoc(getattr(rattle, name))
    assert ">>> " in text.partition("\nExamples\n---")[2]
    assert "+SKIP" not in text
    if name in CLASSES:
        assert re.search("\n(Parameters|Attributes)\n---", text)
        return
    assert text.splitlines()[0].endswith(".")
    for section in ("Parameters", "Returns"):
        assert f"\n{section}\n---" in text, section
    for parameter in inspect.signature(getattr(rattle, name)).parameters:
        assert re.search(rf"^(?:[\w, *]*, )?\**{parameter}\b", text, flags=re.M), parameter


@pytest.mark.parametrize("name", CLASSES)
def test_every_public_member_has_a_sentence(name):
    for member, value in vars(getattr(rattle, name)).items():
        if not member.startswith("_") and (
            inspect.isfunction(value) or isinstance(value, property)
        ):
            assert inspect.getdoc(value), f"{name}.{member}"
