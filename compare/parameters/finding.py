"""What boundaries, maps, crossings and sensitivities find has in common, and its words."""

from typing import Any, ClassVar

import pandas as pd

from rattle.compare.report.texts import read_texts
from rattle.compare.validation.verdict import Verdict
from rattle.scene import as_html
from rattle.scene.numpy_errors import numpy_defaults

PARAMETER_TEXTS = read_texts("parameters")


def quantity_words(quantity: str) -> str:
    """A quantity in words."""
    kind, _, mesh = quantity.partition("_mesh")
    words = PARAMETER_TEXTS["quantities"].get(kind, f"`{kind}`")
    return f"{words} at mesh {mesh}" if mesh else str(words)


def value_text(value: Any, unit: Any) -> str:
    """A value with its unit."""
    return f"{float(f'{value:.3g}'):,g} {unit}".rstrip()


def with_unit(name: str, unit: str) -> str:
    """A name with its unit, if it has one."""
    return f"{name} ({unit})" if unit else name


def list_values(values: Any) -> str:
    """Values after each other."""
    return ", ".join(f"{value:.4g}" for value in values)


def list_undecided(points: pd.DataFrame, over: str, unit: str) -> list[str]:
    """Where a search has not decided, and why, a sentence for each reason."""
    undecided = points[points["verdict"] == Verdict.UNDECIDED]
    return [
        f"Undecided at {over} = {list_values(rows['value'])}{unit}: {str(why).rstrip('.')}."
        for why, rows in undecided.groupby("remark", sort=False)
    ]


@numpy_defaults
class Finding:
    """What a search, or a comparison of runs, has found: the base of dataclasses."""

    title: ClassVar[str]  # with attributes between braces
    shown: ClassVar[str]  # the table below the answer in a notebook
    plain: ClassVar[tuple[str, ...]]  # attributes in `to_dict`

    @property
    def answer(self) -> list[str]:
        """In sentences."""
        raise NotImplementedError

    def __repr__(self) -> str:
        """What was found, on a few lines."""
        return "\n".join(
            [self.title.format_map(vars(self)), *(f"  {line}" for line in self.answer)]
        )

    def _repr_html_(self) -> str:
        return as_html(repr(self), getattr(self, self.shown).to_html(max_rows=40))

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain data: tables by their rows, edges by the names of their fields."""
        data = {name: getattr(self, name) for name in self.plain}
        for name, value in data.items():
            if isinstance(value, pd.DataFrame):
                data[name] = (value.reset_index() if value.index.name else value).to_dict("records")
            elif isinstance(value, tuple):
                data[name] = [one._asdict() if hasattr(one, "_asdict") else one for one in value]
        return data
