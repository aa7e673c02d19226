"""What a validation and a sweep found, as data: figures, tables, sentences and pages are functions of it."""

from dataclasses import dataclass
from typing import NamedTuple

import pandas as pd

from rattle.closure import MeanMap
from rattle.compare.validation.verdict import Tolerances
from rattle.montecarlo import Ensemble
from rattle.scene.scene import Scene


@dataclass(frozen=True)
class Comparison:
    """The fields of a `Validation`, where they are explained."""

    scene: Scene
    predictions: dict[str, MeanMap]
    run: Ensemble
    table: pd.DataFrame
    correlation: pd.DataFrame
    z: float
    tolerances: Tolerances

    def section_rows(self, closure: str) -> pd.DataFrame:
        """The rows of ``table`` on the section moments of a closure."""
        return self.table[(self.table["closure"] == closure) & (self.table["kind"] == "section")]


class Sweep(NamedTuple):
    """Ranges of validity and speed-ups of all closures at all noise intensities."""

    validity: pd.DataFrame  # columns of `rattle.compare.validation.validity.Validity`
    speed: pd.DataFrame  # columns of `rattle.compare.validation.speed.Speed`
    simulation: pd.DataFrame  # from `rattle.compare.validation.speed.simulation_costs`, a row for each noise intensity
