"""What boundaries, maps, crossings and sensitivities find has in common, and its words."""

from typing import Any, ClassVar

import pandas as pd

from rattle.compare.judge.verdict import Verdict
from rattle.compare.report.finding import Finding
from rattle.compare.report.texts import read_texts
from rattle.montecarlo.looks import BUDGET_ENDED
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


def after_number(unit: str) -> str:
    """A unit as it stands after a number, if there is one."""
    return f" {unit}" if unit else ""


def list_values(values: Any) -> str:
    """Values after each other."""
    return ", ".join(f"{value:.4g}" for value in values)


def by_error(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows with a verdict, the largest error over its tolerance first."""
    excess = rows["error"].abs() / rows["tolerance"]
    return rows.loc[excess.sort_values(ascending=False, kind="stable").index]


@numpy_defaults
class AlongParameter(Finding):
    """What a search along a parameter has found: the base of `Boundary` and `Crossing`."""

    shown = "points"
    first: ClassVar[str]  # the verdict while what is judged is small
    # a parameter with which what is judged is known to grow
    grows_with: ClassVar[str] = ""

    over: str
    unit: str
    edges: tuple[Any, ...]
    points: pd.DataFrame

    @property
    def answer(self) -> list[str]:
        """Where the verdict changes in words, and what is not known."""
        texts = PARAMETER_TEXTS["answers"][type(self).__name__]
        values = self.points["value"]
        facts = vars(self) | {"number": len(values), "least": values.min(), "most": values.max()}
        facts |= {name: after_number(facts[name]) for name in facts if name.endswith("unit")}
        decided = self.points[self.points["verdict"] != Verdict.UNDECIDED]
        verdicts = decided["verdict"].unique()
        said = [texts["edge"].format_map(facts | describe_edge(edge)) for edge in self.edges]
        if len(self.edges) > 1:
            said.append(texts["several"])
        if len(verdicts) == 1 and len(decided) == len(values):
            said.append(texts[verdicts[0]].format_map(facts))
            said.append(texts["outside"].format(where=self._describe_outside(verdicts[0])))
        elif not self.edges:
            facts["known"] = ""
            if len(decided):
                at = f"{list_values(decided['value'])}{facts['unit']}"
                facts["known"] = f"; it is {verdicts[0]} at {at}"
            said.append(texts["none"].format_map(facts))
        undecided = self.points[self.points["verdict"] == Verdict.UNDECIDED]
        for why, rows in undecided.groupby("remark", sort=False):
            at = f"{self.over} = {list_values(rows['value'])}{facts['unit']}"
            said.append(f"Undecided at {at}: {str(why).rstrip('.')}.")
        if (undecided["remark"] == BUDGET_ENDED).any():
            said.append(PARAMETER_TEXTS["answers"]["larger"])
        return [*said, texts["count"].format_map(facts)]

    def _describe_outside(self, verdict: str) -> str:
        """On which side of the range to look for a change, where all of it has one verdict."""
        first = self.points.iloc[0]
        last = self.points.iloc[-1]
        below = f"below {first['value']:.4g}"
        above = f"above {last['value']:.4g}"
        falls = first["low"] > last["high"]
        grows = last["low"] > first["high"] or (self.over == self.grows_with and not falls)
        where = above if grows == (verdict == self.first) else below
        if not grows and not falls:
            where = f"{below} or {above}"
        return where + after_number(self.unit)


def describe_edge(edge: Any) -> dict[str, Any]:
    """What a sentence says of a pair of values between which the verdict changes."""
    names = edge._fields[:2]
    facts: dict[str, Any] = edge._asdict() | {"way": "up to", "first": names[0], "then": names[1]}
    if edge[0] > edge[1]:
        facts |= {"way": "down to", "first": names[1], "then": names[0]}
    return facts | {"low": min(edge[:2]), "high": max(edge[:2])}
