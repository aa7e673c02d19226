"""What boundaries, maps, crossings and sensitivities find has in common, and its words."""

from functools import partial
from typing import Any, ClassVar

import pandas as pd

from rattle.compare.report.finding import Finding
from rattle.compare.report.render import render_sentences
from rattle.compare.report.texts import label_quantity, read_texts, wheel_label
from rattle.montecarlo.looks import BUDGET_ENDED
from rattle.scene import Scene
from rattle.scene.numpy_errors import numpy_defaults

PARAMETER_TEXTS = read_texts("parameters")


def quantity_words(scene: Scene, quantity: str) -> str:
    """A quantity of a scene in words."""
    kind, _, mesh = quantity.partition("_mesh")
    second = "second" if scene.gears else "unit of dimensionless time"
    words = str(PARAMETER_TEXTS["quantities"].get(kind, f"`{kind}`")).format(second=second)
    return f"{words} at mesh {wheel_label(scene, int(mesh))}" if mesh else words


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

    scene: Scene
    over: str
    unit: str
    edges: tuple[Any, ...]
    points: pd.DataFrame

    @property
    def answer(self) -> list[str]:
        """Where the verdict changes in words, and what is not known."""
        points = self.points.to_dict("records")
        return render_sentences(
            "parameters/search_answer.j2",
            self.scene.words,
            found=self,
            points=points,
            budget_ended=BUDGET_ENDED,
            label=partial(label_quantity, self.scene),
        )
