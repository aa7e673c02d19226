"""The numerical version: a digest of everything but the input that decides the numbers."""

import ast
import hashlib
import importlib.metadata
import platform
from collections.abc import Iterator
from functools import cache
from pathlib import Path

__all__ = ["numerical_version"]

PACKAGES = ("scene", "closure", "montecarlo")
LIBRARIES = ("numpy", "numba", "llvmlite", "scipy")


@cache
def numerical_version(*packages: str) -> str:
    """Digest of the code that makes numbers, of the libraries under it, and of the kind of processor.

    Code counts as it is understood, not as it is written: comments, docstrings and layout may change.

    Parameters
    ----------
    *packages : str
        Packages whose code makes the numbers in question; all by default.

    Examples
    --------
    >>> numerical_version() == numerical_version()
    True
    """
    digest = hashlib.sha256(platform.machine().encode())
    for library in LIBRARIES:
        digest.update(f"{library} {importlib.metadata.version(library)};".encode())
    for path in _sources(packages or PACKAGES):
        digest.update(path.name.encode() + _meaning_of(path).encode())
    return digest.hexdigest()[:16]


def _sources(packages: tuple[str, ...]) -> Iterator[Path]:
    root = Path(__file__).resolve().parents[2]
    for package in packages:
        yield from sorted((root / package).rglob("*.py"))


@cache
def _meaning_of(path: Path) -> str:
    return _meaning(path.read_text(encoding="utf-8"))


def _meaning(source: str) -> str:
    """The syntax tree of a source, without its docstrings."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node, clean=False):
            node.body = node.body[1:]
    return ast.dump(tree)
