"""The base of results that say in sentences what was found."""

from dataclasses import fields
from typing import ClassVar

import pandas as pd

from rattle.compare.report.json_text import Facts
from rattle.scene import as_html
from rattle.scene.numpy_errors import numpy_defaults


@numpy_defaults
class Finding:
    """What a search, a comparison of runs or a run-up has found: the base of dataclasses."""

    title: ClassVar[str]  # with attributes between braces
    shown: ClassVar[str]  # the table below the answer in a notebook

    @property
    def answer(self) -> list[str]:
        """In sentences."""
        raise NotImplementedError

    def __repr__(self) -> str:
        """What was found, on a few lines."""
        return "\n  ".join([self.title.format_map(vars(self)), *self.answer])

    def _repr_html_(self) -> str:
        return as_html(repr(self), getattr(self, self.shown).to_html(max_rows=40))

    def to_dict(self) -> Facts:
        """Everything as plain data: tables by their rows, edges by the names of their fields."""
        data: Facts = {"answer": self.answer}
        for field in fields(self):  # type: ignore[arg-type]  # of a dataclass
            value = getattr(self, field.name)
            if isinstance(value, pd.DataFrame):
                value = (value.reset_index() if value.index.name else value).to_dict("records")
            elif isinstance(value, tuple):
                value = [one._asdict() if hasattr(one, "_asdict") else one for one in value]
            data[field.name] = value
        del data["scene"]
        return data

    @property
    def facts(self) -> Facts:
        """The same for the manifest of a page, which holds answer and tables apart."""
        tables = [name for name, value in vars(self).items() if isinstance(value, pd.DataFrame)]
        return {k: v for k, v in self.to_dict().items() if k not in ("answer", *tables)}
