"""Texts of the pages as data: each folder keeps them in ``texts.toml``.

The words and symbols of the pages are explained once; the glossary of a page shows those that it
uses.
"""

import tomllib
from collections.abc import Iterable, Sequence
from importlib.resources import files
from typing import Any

import pandas as pd

from rattle.scene import Gears, InputError, Scene


def read_texts(package: str) -> dict[str, Any]:
    """The entries of ``texts.toml`` in a folder of `rattle.compare`; within a text a line break is
    a space."""
    return {
        name: _join_lines(value)
        for name, value in tomllib.loads(read_file(package, "texts.toml")).items()
    }


def _join_lines(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _join_lines(inner) for name, inner in value.items()}
    return " ".join(value.split()) if isinstance(value, str) else value


def wheel_label(scene: Scene, wheel: int) -> str:
    """The number of a wheel or of its mesh, and the name that its file gives it: "2 (shaft)"."""
    name = scene.wheel_names[wheel - 1]
    return str(wheel) if name == str(wheel) else f"{wheel} ({name})"


def name_wheels(scene: Scene) -> list[str]:
    """Which wheel has which name and meshes with which other one, for a list of sentences; nothing
    for the short form of one or two wheels."""
    if not scene.wheels:
        return []
    if scene.bodies and scene.stages == 1:
        return [f"x1 and y1 are displacement and velocity of the body {scene.wheel_names[0]}."]
    meshes = ", ".join(
        f"{wheel_label(scene, number)} with {wheel.parent or 'the driver'}"
        for number, wheel in enumerate(scene.tree, 1)
    )
    if scene.bodies:
        strikes = meshes.replace(" with ", " strikes ")
        return [f"Body {strikes}. Contact 1, x1 and y1 are those of body 1, and so on."]
    meshes = meshes.replace(" with ", " meshes with ", 1)
    return [f"Wheel {meshes}. Mesh and stage 1, x1 and y1 are those of wheel 1, and so on."]


def label_quantity(scene: Scene, quantity: str) -> str:
    """The name of a quantity, and the name of the wheel at its mesh: "power_mesh2 (shaft)"."""
    name, _, mesh = quantity.partition("_mesh")
    # a study may have scenes of more wheels than its own
    label = wheel_label(scene, int(mesh)) if mesh and int(mesh) <= scene.stages else mesh
    return f"{name}_mesh{label}" if mesh else name


def label_quantities(scene: Scene, rows: pd.DataFrame) -> pd.DataFrame:
    """Rows whose quantities have the names of the wheels at their meshes, as a page shows them."""
    return rows.assign(quantity=[label_quantity(scene, name) for name in rows["quantity"]])


def read_file(package: str, name: str) -> str:
    """The text of a file in a folder of `rattle.compare`."""
    return files("rattle.compare").joinpath(*package.split("."), name).read_text(encoding="utf-8")


REPORT_TEXTS = read_texts("report")
TERMS: dict[str, str] = REPORT_TEXTS["terms"]
"""Meaning of each term, in plain words, in the order in which a page lists them."""


def _spread(names: Iterable[str]) -> set[str]:
    """Terms, in place of the name of a page or of a list the terms in it."""
    lists = REPORT_TEXTS["words"]
    return {term for name in names for term in (_spread(lists.get(name, ())) or {name})}


def glossary(*names: str, gears: Gears | None = None) -> tuple[tuple[str, str], ...]:
    """The terms that a page uses with their meanings, in the order of `TERMS`; with gears, what 1
    is in their units.

    `names`: Of terms, of lists of them, and of pages.
    """
    wanted = _spread(names)
    if unknown := wanted - TERMS.keys():
        raise InputError("names", unknown.pop(), "is not explained; add it to TERMS")
    terms = {name: meaning for name, meaning in TERMS.items() if name in wanted}
    if gears is not None:
        units = gears.units._asdict() | {"each_second": 1e3 / gears.units.time}
        of_terms = REPORT_TEXTS["units"].items()
        ones = {name: one.format(**units) for name, one in of_terms if name in terms}
        terms |= {name: f"{terms[name]}; 1 is {one} for these gears" for name, one in ones.items()}
    return tuple(terms.items())


def join_words(items: Sequence[str]) -> str:
    """Join items as in a sentence: commas, and ``and`` before the last."""
    return items[0] if len(items) == 1 else ", ".join(items[:-1]) + " and " + items[-1]


def name_all(names: Iterable[str]) -> str:
    """Some names in code, joined as in a sentence."""
    return join_words([f"`{name}`" for name in names])


def span(values: Iterable[float], form: str) -> str:
    """The range of some values in words; one value where they are the same as printed.

    >>> span([17.257, 17.262], ".4g"), span([0.05, 0.1], ".0%")
    ('17.26', '5% to 10%')
    """
    listed = list(values)
    low = format(min(listed), form)
    high = format(max(listed), form)
    return low if low == high else f"{low} to {high}"
