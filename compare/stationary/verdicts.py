"""The closures in the long run, each against the simulation, with a verdict on every quantity."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import ndtr

from rattle.closure.attractor import Attractor, attractor
from rattle.closure.stationary import Law, NotPredicted, branching_law, linear_law, orbit_average
from rattle.compare.stationary.laws import values_of
from rattle.compare.validation.verdict import judge, widest
from rattle.montecarlo.long_run.intervals import half_width
from rattle.montecarlo.long_run.names import all_names
from rattle.scene.scene import Scene

CLOSURES_JUDGED = {
    "saltation": "linear at a periodic orbit",
    "published": "orbit average",
    "corrected": "orbit average",
    "branching": "mixture",
}
"""The closures, and what each takes for the stationary law."""

TOLERANCES = (
    "Accurate: rates and energies within 5 %, means within 5 % of an sd, sds and quantiles within 10 % of an sd, "
    "skewness within 0.1, shares within 0.01, each with its whole interval (95 % simultaneous coverage over all rows "
    "of the table)."
)
"""What counts as accurate, as pages state it."""

RATES = ("rate", "energy", "power")


def laws(scene: Scene, closures: tuple[str, ...], a: Attractor | None = None) -> dict[str, Law | str]:
    """The stationary law of each closure, or the reason why it has none."""
    end = attractor(scene) if a is None else a
    by: dict[str, Callable[[], Law]] = {
        "saltation": lambda: linear_law(scene, end),
        "published": lambda: orbit_average(scene, "published"),
        "corrected": lambda: orbit_average(scene, "corrected"),
        "branching": lambda: branching_law(scene),
    }
    found: dict[str, Law | str] = {}
    for closure in closures:
        try:
            found[closure] = by[closure]()
        except NotPredicted as why:
            found[closure] = str(why)
    return found


def tolerance_of(name: str, values: dict[str, float]) -> float:
    """The largest error of a quantity that counts as accurate."""
    if name.startswith(RATES):
        return 0.05 * abs(values[name])
    if "share" in name:
        return 0.01
    if name.startswith("skew_"):
        return 0.1
    what = name.split("_", 1)[1] if name.startswith(("sd_", "q")) else name
    return (0.05 if what == name else 0.10) * values.get("sd_" + what, float("nan"))


def predictions(found: dict[str, Law | str], scene: Scene, slow: float) -> pd.DataFrame:
    """What each closure says of every quantity.

    Returns: Columns ``closure, kind, quantity, predicted, se_predicted, reason``; NaN and a reason where it says
    nothing.
    """
    parts = []
    for closure, law in found.items():
        has = isinstance(law, Law)
        values = values_of(law, scene, slow) if isinstance(law, Law) else dict.fromkeys(all_names(scene.stages), np.nan)
        own = law.se if isinstance(law, Law) else 0.0
        parts.append(
            pd.DataFrame(
                {
                    "closure": closure,
                    "kind": CLOSURES_JUDGED[closure],
                    "quantity": list(values),
                    "predicted": list(values.values()),
                    "se_predicted": [own * abs(v) for v in values.values()],
                    "reason": "" if has else str(law),
                }
            )
        )
    columns = ["closure", "kind", "quantity", "predicted", "se_predicted", "reason"]
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=columns)


def judge_predictions(table: pd.DataFrame, periods: int, predicted: pd.DataFrame) -> pd.DataFrame:
    """Compare the predictions of closures with a simulation.

    Returns: Columns ``closure, kind, quantity, predicted, simulated, se, error, low, high, tolerance, verdict,
    periods_needed, reason``; the interval of the error holds the errors of both sides.
    """
    simulated = {str(name): float(value) for name, value in table["value"].items()}
    rows = predicted[predicted["quantity"].isin(simulated)].reset_index(drop=True)
    rows["tolerance"] = [tolerance_of(str(name), simulated) for name in rows["quantity"]]
    return judge_rows(rows, table, widest(int(rows["predicted"].notna().sum())), periods)[
        [
            "closure",
            "kind",
            "quantity",
            "predicted",
            "simulated",
            "se",
            "error",
            "low",
            "high",
            "tolerance",
            "verdict",
            "periods_needed",
            "reason",
        ]
    ]


def judge_rows(predicted: pd.DataFrame, table: pd.DataFrame, z: float, periods: int) -> pd.DataFrame:
    """Intervals of the errors of predictions, and verdicts.

    `z`: Half width of the intervals in standard errors where these rest on all paths; wider where on few.
    Returns: With ``simulated, se, error, low, high, verdict, periods_needed``, and ``effective_paths`` and
    ``widened``: how many paths carry the error, and the half width of the interval in standard errors for that.
    """
    rows = predicted.copy()
    rows["simulated"] = rows["quantity"].map(table["value"].to_dict()).astype(float)
    rows["se"] = rows["quantity"].map(table["se"].to_dict()).astype(float)
    rows["error"] = rows["predicted"].astype(float) - rows["simulated"]
    rows["effective_paths"] = rows["quantity"].map(table["effective_paths"].to_dict()).astype(float)
    rows["widened"] = _width(rows["effective_paths"], z)
    se = (rows["se"] ** 2 + rows["se_predicted"].astype(float) ** 2) ** 0.5
    rows["noise"] = rows["widened"] * se
    rows["low"], rows["high"] = rows["error"] - rows["noise"], rows["error"] + rows["noise"]
    found = judge(rows.assign(paths=float(periods))).rename(columns={"paths_needed": "periods_needed"})
    margin = (rows["error"].abs() - rows["tolerance"]).abs()
    needed = np.ceil(periods * _times_longer(rows["effective_paths"], se, margin, z))
    return found.assign(periods_needed=found["periods_needed"].where(found["periods_needed"].isna(), needed))


def _width(effective: pd.Series, z: float) -> Any:
    """Half width of an interval in standard errors; `z` where all paths carry the error, or nothing varies."""
    widened = half_width(effective, float(ndtr(-z)))
    return np.where(np.isnan(widened), z, widened)


def _times_longer(effective: pd.Series, se: pd.Series, margin: pd.Series, z: float) -> Any:
    """How many times longer a run decides its rows: its rare bursts are then as many times more, on more paths."""
    low, high = np.zeros(len(se)), np.full(len(se), 40.0)  # log of the factor: the half width falls with it
    for _ in range(50):
        middle = 0.5 * (low + high)
        wide = _width(effective * np.exp(middle), z) * se * np.exp(-0.5 * middle) > margin
        low, high = np.where(wide, middle, low), np.where(wide, high, middle)
    return np.exp(high)
