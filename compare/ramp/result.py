"""The result of a run-up, and what it says in sentences."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pandas as pd

from rattle.compare.report.finding import Finding
from rattle.compare.report.json_text import Facts
from rattle.compare.report.render import render_sentences
from rattle.compare.stationary.result import speed_text
from rattle.scene import Scene
from rattle.scene.numpy_errors import numpy_defaults

if TYPE_CHECKING:
    from matplotlib.figure import Figure

QUANTITIES = {"rate_above": 0, "speed_above": 1, "power": 2}
"""Quantities over the speed, and which of `rattle.montecarlo.long_run.ramp.COUNTED` they are of."""
POWERS = {"rate_above": 1, "power": 3}
"""Powers of the speed that these quantities are proportional to where the motion is the same."""


@numpy_defaults
@dataclass(frozen=True, repr=False)
class RunUp(Finding):
    """Rattle over the driver's mean speed, from `run_up`.

    Attributes
    ----------
    scene : Scene
    first, last : float
        Mean speed at the beginning and the end of the ramp, 1/min.
    seconds : float
        Duration of the ramp.
    slow : float
        Speed below which an impact is slow, dimensionless at the file's speed.
    table : DataFrame
        A row for each quantity (``rate_above``, ``speed_above``, ``power``, also by mesh) and speed
        ``rpm``: ``value, se, low, high`` at that constant speed; ``ramp, se_ramp, ramp_low,
        ramp_high`` of the ramp around it, whose mean speed there is ``ramp_rpm``; ``difference,
        se_difference, difference_low, difference_high`` of the ramp from constant speeds averaged
        alike, with an ``allowance`` for what is not known between the speeds, and whether it
        ``differs`` with 95 % probability for all rows together; in 1/s, mm/s and mW.
    points : DataFrame
        A row for each speed: excitation ``omega``, drag and threshold of rattle of each wheel in
        N mm, the ``paths, periods, burn_in`` of the run, and a ``remark`` why there is none.
    thresholds : DataFrame
        Speeds at which closed teeth of a ``wheel``, of that ``name``, begin to open without noise
        (``opens``: above that speed), at constant speed and in the ramp; NaN where it is the same
        at all speeds.
    overall : DataFrame
        Over the whole ramp: how much more or less than at constant speeds, and what halving the
        stretches of the ramp changes, as shares, with 95 % intervals.
    added_torque : tuple of float
        What the acceleration adds to the drag of each wheel, N mm.
    ramp_paths, ramp_periods : int
        Paths of the ramp, 0 if it was left out, and its periods of the excitation.
    complete : float
        Budget in seconds from which on nothing is left out; 0 where nothing was.
    """

    title = "Run-up from {first:g} to {last:g} 1/min in {seconds:g} s"
    shown = "table"

    scene: Scene
    first: float
    last: float
    seconds: float
    slow: float
    table: pd.DataFrame
    points: pd.DataFrame
    thresholds: pd.DataFrame
    overall: pd.DataFrame
    added_torque: tuple[float, ...]
    ramp_paths: int
    ramp_periods: int
    complete: float

    @property
    def answer(self) -> list[str]:
        """Where it rattles most, where it begins, and what the ramp changes."""
        power = self.table[self.table["quantity"] == "power"].set_index("rpm")
        most = power["value"].idxmax() if power["value"].notna().any() else None
        at_most = self.table[self.table["rpm"] == most].set_index("quantity")
        meshes = range(1, self.scene.stages + 1)
        by_mesh = at_most["value"].reindex([f"power_mesh{mesh}" for mesh in meshes])
        loudest = 1 + int(by_mesh.to_numpy().argmax()) if by_mesh.notna().all() else None
        seen = self.table[(self.table["quantity"] == "rate_above") & (self.table["low"] > 0.0)]
        changes = pd.DataFrame()
        if self.ramp_paths:
            whole = self.table[~self.table["quantity"].str.contains("_mesh")]
            changes = whole[whole["differs"]]
        return render_sentences(
            "ramp/answer.j2",
            self.scene.words,
            found=self,
            most=most,
            at_most=at_most.to_dict("index"),
            loudest=loudest,
            least=speed_text(self.slow, self.scene.gears, "physical"),
            begins=seen["rpm"].min() if len(seen) else None,
            speeds=self.points["remark"].eq("").sum(),
            thresholds=_join_wheels(self.thresholds),
            changes=[_largest(rows) for _, rows in changes.groupby("quantity", sort=False)]
            if len(changes)
            else [],
            overall=self.overall.to_dict("records"),
            missing=self.points[self.points["remark"] != ""].groupby("remark")["rpm"].apply(list),
        )

    def plot(self) -> "Figure":
        """Draw impacts, power and speeds over the mean speed.

        Returns
        -------
        Figure
            Of matplotlib; a notebook shows it, ``savefig`` writes it.
        """
        from rattle.compare.ramp.figures import run_up_figure

        return run_up_figure(self.table, self.thresholds, self.points["rpm"])


def _join_wheels(thresholds: pd.DataFrame) -> list[Facts]:
    """Thresholds with all the `wheels` of which the same is said; without a speed None."""
    columns = ["motion", "rpm", "opens"]
    same = thresholds.groupby(columns, sort=False, dropna=False, as_index=False)
    rows: list[Facts] = same.agg(wheels=("wheel", list)).to_dict("records")  # type: ignore[assignment]
    return [row | {"rpm": None if pd.isna(row["rpm"]) else row["rpm"]} for row in rows]


def _largest(rows: pd.DataFrame) -> dict[Any, Any]:
    """The row with the largest difference in standard errors."""
    size = (rows["difference"] / rows["se_difference"]).abs()
    return rows.to_dict("records")[int(size.argmax())]
