"""The numerical version: a digest of everything besides the input that determines the numbers."""

import ast
import hashlib
import importlib.metadata
import platform
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite.binding

from rattle.compare.report.json_text import json_digest
from rattle.scene.machine_code import has_fma
from rattle.scene.scene import Scene

PACKAGES = ("scene", "closure", "montecarlo")
LIBRARIES = ("numpy", "numba", "llvmlite", "scipy")


@cache
def numerical_version(*packages: str) -> str:
    """Compute a digest of the numerical code, of its libraries, and of the kind of processor.

    All x86-64 processors with AVX2 and FMA are of one kind, for their bits agree.  Each other is a kind of its own.

    The code enters as a syntax tree without docstrings: comments, docstrings and layout do not change the digest.

    Examples
    --------
    >>> numerical_version() == numerical_version()
    True
    """
    digest = hashlib.sha256(" ".join((_processor(), *platform.libc_ver())).encode())
    for library in LIBRARIES:
        digest.update(f"{library} {importlib.metadata.version(library)};".encode())
    for path in _sources(packages or PACKAGES):
        digest.update(path.name.encode() + _meaning_of(path).encode())
    return digest.hexdigest()[:16]


def cell_key(kind: str, packages: tuple[str, ...], scene: Scene, settings: Mapping[str, Any]) -> str:
    """Digest of a scene's dimensionless numbers, the settings, and the version of the code that makes the result."""
    numbers = replace(scene, gears=None).to_dict()  # without the gears that it came from
    content = {"kind": kind, "scene": numbers, "settings": settings, "version": numerical_version("scene", *packages)}
    return json_digest(content)[:32]


def _processor() -> str:
    """The kind of processor, by the bits it gives."""
    machine = platform.machine()
    if machine.lower() in ("x86_64", "amd64") and has_fma():
        return "x86-64 with AVX2 and FMA"
    return f"{machine} {llvmlite.binding.get_host_cpu_name()}"


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
