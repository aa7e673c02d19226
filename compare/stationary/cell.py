"""The long run of a scene as a cell of a study: computed once, and found in the store under its key."""

import time
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import pandas as pd

from rattle.compare.stationary.measure import stationary
from rattle.compare.stationary.verdicts import judge_predictions, predictions
from rattle.compare.study.store import Content
from rattle.compare.study.version import cell_key
from rattle.montecarlo.kernel.blocks import Blocks
from rattle.montecarlo.long_run.parts import IMPACT_SECONDS
from rattle.montecarlo.long_run.run import ACCURACY, PATHS
from rattle.scene.errors import InputError
from rattle.scene.scene import Scene

STORED = ["value", "se", "low", "high", "autocorrelation", "se_batches", "effective_paths"]
PREDICTED = ("closure", "kind", "quantity", "predicted", "se_predicted", "reason")
SPREAD = 2.0  # typical sd over mean of what is averaged, with its autocorrelation


@dataclass(frozen=True)
class LongResult:
    """The long run of a scene as read from the store."""

    table: pd.DataFrame  # as of `rattle.compare.stationary.measure.Stationary`
    predicted: pd.DataFrame  # as of `rattle.compare.stationary.verdicts.predictions`
    facts: dict[str, Any]  # ``kind, said, periods, paths, impacts, burn_in, seconds``

    @property
    def verdicts(self) -> pd.DataFrame:
        """The closures against the simulation; empty for exact values."""
        if self.facts["kind"] != "simulated" or self.predicted.empty:
            return pd.DataFrame()
        return judge_predictions(self.table, self.facts["periods"], self.predicted)


@dataclass(frozen=True)
class LongCell:
    """The long run of a scene."""

    group: ClassVar[str] = "long runs"
    splits: ClassVar[bool] = False

    scene: Scene
    seed: int
    closures: tuple[str, ...]
    accuracy: float | None = None
    periods: int | None = None
    paths: int = PATHS
    burn_in: int | None = None
    slow: float = 0.1

    @cached_property
    def key(self) -> str:
        """Digest of everything that determines the result."""
        settings = {
            "seed": self.seed,
            "closures": list(self.closures),
            "accuracy": self.accuracy,
            "periods": self.periods,
            "paths": self.paths,
            "burn_in": self.burn_in,
            "slow": self.slow,
            "columns": [*STORED, *PREDICTED],
        }
        return cell_key("stationary", ("closure", "montecarlo"), self.scene, settings)

    @property
    def label(self) -> str:
        """Short description for the progress line."""
        return f"long run sigma {self.scene.sigma:.3g}"

    @property
    def core_seconds(self) -> float:
        """Rough estimate of the cost."""
        impacts = (self.periods or 0) * self.paths * 12.0
        if self.periods is None:
            impacts = (2.0 * SPREAD / (self.accuracy or ACCURACY)) ** 2
        return IMPACT_SECONDS * (impacts + 60.0 * 12.0 * self.paths) + 2.5 * ("branching" in self.closures)

    def compute(self, blocks: Blocks | None = None) -> Content:
        """Follow the long run."""
        started = time.perf_counter()
        found = stationary(
            self.scene.phase_reduced,
            accuracy=self.accuracy,
            periods=self.periods,
            paths=self.paths,
            burn_in=self.burn_in,
            slow=self.slow,
            closures=self.closures,
            rng=self.seed,
        )
        run = found.run
        if run is not None and run.reach is not None and not run.reach.reached:
            raise InputError("accuracy", self.accuracy, run.reach.sentence)  # where it stopped depends on wall time
        predicted = predictions(found.laws, found.scene, self.slow) if run is not None else pd.DataFrame()
        facts: dict[str, Any] = {"kind": found.kind, "said": found.said, "periods": 0, "paths": 0, "impacts": 0}
        if run is not None:
            facts |= {"periods": run.periods, "paths": run.paths, "impacts": run.impacts}
        facts |= {"burn_in": 0 if run is None else run.burn_in.periods, "seconds": time.perf_counter() - started}
        parts = [found.table.reset_index().assign(closure=""), predicted]
        return Content(pd.concat([part for part in parts if len(part)], ignore_index=True), facts)

    def restore(self, content: Content) -> LongResult:
        """Turn a stored result back into tables."""
        own = content.table["closure"] == ""
        names = [c for c in PREDICTED if c in content.table]
        facts = {name: content.facts[name] for name in ("kind", "said", "periods", "paths", "impacts", "burn_in")}
        return LongResult(
            content.table[own].set_index("quantity")[STORED],
            content.table.loc[~own, names],
            facts | {"seconds": content.facts["seconds"]},
        )
