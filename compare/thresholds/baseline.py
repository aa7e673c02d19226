"""Baselines: recorded predictions of a model, in a readable file next to the test."""

import hashlib
import re
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import tomli_w

from rattle.compare.report.folder import write_whole
from rattle.compare.thresholds.claim import Claim
from rattle.compare.thresholds.prediction import ModelPrediction
from rattle.scene.errors import FileError
from rattle.scene.files import read_text
from rattle.scene.text import line

Changes = dict[str, tuple[Any, Any]]
"""Recorded and present value, by dotted key in the file; None for a missing one."""


def place(module: Path, test: str) -> Path:
    """Give the path of a test's baseline.

    Examples
    --------
    >>> place(Path("tests/test_gate.py"), "test_mine").as_posix()
    'tests/baselines/test_gate/test_mine.toml'
    """
    name = re.sub(r"[^\w.\[\]-]+", "-", test)
    if name != test:  # two tests may not share a file
        name += "-" + hashlib.sha256(test.encode()).hexdigest()[:6]
    return module.parent / "baselines" / module.stem / f"{name}.toml"


def content(prediction: ModelPrediction, claim: Claim) -> dict[str, Any]:
    """Build the content of a baseline."""
    values = {
        c: dict(zip(map(str, claim.impacts), map(float, prediction.section[c]), strict=True)) for c in claim.columns
    }
    return {"values": values, **replace(claim.scene).to_dict()}


def read(path: Path) -> dict[str, Any]:
    """Read a recorded baseline."""
    try:
        found = tomllib.loads(read_text("baseline", path))
    except FileError:
        raise
    except (ValueError, RecursionError) as error:
        raise FileError("baseline", str(path), f"is damaged ({error}); restore it, or remove and record it") from None
    if not isinstance(found.get("values"), dict):
        raise FileError("baseline", str(path), "has no table [values]; restore it, or remove and record it")
    return found


def write(path: Path, found: Mapping[str, Any], model: str) -> None:
    """Write a baseline atomically."""
    what = f"Section moments of {line(model)} by quantity and impact, and their scene"
    head = f"# {what}; written by pytest\n# --rattle-baselines=record (or =regenerate).\n\n"
    write_whole(path, head + tomli_w.dumps(found))


def _flat(table: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in table.items():
        found |= _flat(value, f"{before}{key}.") if isinstance(value, Mapping) else {before + key: value}
    return found


def changes(recorded: Mapping[str, Any], now: Mapping[str, Any], relative: float, absolute: float) -> Changes:
    """Compare two contents.

    `relative`, `absolute`: A value may differ by ``absolute + relative * |recorded|``; everything else must be
    equal.

    Examples
    --------
    >>> changes({"values": {"y1": {"2": 0.5}}}, {"values": {"y1": {"2": 0.6}}}, 1e-9, 1e-12)
    {'values.y1.2': (0.5, 0.6)}
    """
    old, new = _flat(recorded), _flat(now)

    def same(key: str) -> bool:
        a, b = old.get(key), new.get(key)
        if key.startswith("values.") and isinstance(a, int | float) and isinstance(b, int | float):
            return abs(b - a) <= absolute + relative * abs(a)
        return bool(a == b)

    return {key: (old.get(key), new.get(key)) for key in dict.fromkeys([*old, *new]) if not same(key)}


def update(recorded: Mapping[str, Any], now: Mapping[str, Any], changed: Changes) -> dict[str, Any]:
    """Take the present content, but keep the recorded digits of values that have not changed."""

    def merge(old: Mapping[str, Any], new: Mapping[str, Any], before: str) -> dict[str, Any]:
        return {
            key: merge(old.get(key, {}), value, f"{before}{key}.")
            if isinstance(value, Mapping)
            else (value if before + key in changed else old[key])
            for key, value in new.items()
        }

    return merge(recorded, now, "")


def format_changes(changed: Changes) -> list[str]:
    """Format changes as lines of text.

    Examples
    --------
    >>> format_changes({"values.y1.2": (0.5, 0.6), "scene.sigma": (0.1, None)})
    ['  values.y1.2: 0.5 -> 0.6', '  scene.sigma: 0.1 -> nothing']
    """
    return [f"  {line(f'{key}: {_text(old)} -> {_text(new)}')}" for key, (old, new) in changed.items()]


def _text(value: object) -> str:
    return "nothing" if value is None else f"{value:.12g}" if isinstance(value, float) else str(value)
