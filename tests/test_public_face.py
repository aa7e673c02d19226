"""What is public is complete: `rattle.__all__`, the reference and the guide name the same, each
with a full text."""

import inspect
import re
from importlib import import_module

import pytest
from places import ROOT

import rattle

PAGES = ROOT / "docs"
GUIDE_PAGES = [ROOT / "README.md", PAGES / "start.md", *sorted(PAGES.glob("guide/*.md"))]
PUBLIC = {name: getattr(rattle, name) for name in rattle.__all__}
CLASSES = {name: value for name, value in PUBLIC.items() if inspect.isclass(value)}
ERRORS = [name for name, kind in CLASSES.items() if issubclass(kind, Exception)]


def test_the_reference_has_the_public_names_where_they_are_imported_from():
    pages = "".join(page.read_text() for page in PAGES.glob("reference/api-*.md"))
    entries = re.findall(r"(?m)^   (([a-z_]+)[.\w]*)\.(\w+)$", pages)
    assert {name for _, _, name in entries} >= PUBLIC.keys()
    for place, package, name in entries:
        face = import_module("rattle" if name in PUBLIC else f"rattle.{package}")
        if face.__name__ != "rattle.scene":  # which loads neither numba nor what needs it
            found = getattr(import_module(f"rattle.{place}"), name)
            assert found is getattr(face, name), (place, name)


@pytest.mark.parametrize("page", GUIDE_PAGES, ids=lambda page: page.name)
def test_the_guide_needs_nothing_else(page):
    code = "".join(re.findall(r"(?ms)^```(?:python|\{code-cell\})\n(.*?)^```", page.read_text()))
    imported = {*re.findall(r"(?m)^\s*(?:from|import) rattle\.(\S+)", code)}
    assert imported <= {"scene", "closure", "montecarlo", "compare"}
    assert {*re.findall(r"\brt\.(\w+)", code)} <= {*PUBLIC, "__version__"}


@pytest.mark.parametrize(
    "name", [name for name, value in PUBLIC.items() if callable(value) and name not in ERRORS]
)
def test_what_is_public_has_a_full_text(name):
    """With an example, which the doctests run."""
    text = inspect.getdoc(PUBLIC[name])
    assert ">>> " in text.partition("\nExamples\n---")[2]
    assert "+SKIP" not in text
    if name in CLASSES:
        assert re.search("\n(Parameters|Attributes)\n---", text)
        return
    assert text.splitlines()[0].endswith(".")
    assert "\nParameters\n---" in text
    assert "\nReturns\n---" in text
    for parameter in inspect.signature(PUBLIC[name]).parameters:
        assert re.search(rf"(?m)^(?:[\w, *]*, )?\**{parameter}\b", text), parameter


@pytest.mark.parametrize("name", CLASSES)
def test_every_public_member_has_a_sentence(name):
    for member, value in vars(CLASSES[name]).items():
        if member[0] != "_" and (inspect.isfunction(value) or isinstance(value, property)):
            assert inspect.getdoc(value), f"{name}.{member}"
