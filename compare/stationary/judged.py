"""The closures in the long run, each against the simulation, with a verdict on every quantity."""

from collections.abc import Callable

import numpy as np
import pandas as pd

from rattle.closure.attractor import Attractor, attractor
from rattle.closure.stationary import Law, NotPredicted, branching_law, linear_law, orbit_average
from rattle.compare.stationary.laws import values_of
from rattle.compare.validation.verdict import judge, widest
from rattle.montecarlo.long_run.run import LongRun
from rattle.scene.scene import Scene

__all__ = ["CLOSURES_JUDGED", "TOLERANCES", "judged", "laws", "tolerance_of"]

CLOSURES_JUDGED = {
    "saltation": "linear at a periodic orbit", "published": "orbit average", "corrected": "orbit average",
    "branching": "mixture",
}  # fmt: skip
"""The closures, and what each takes for the stationary law."""

TOLERANCES = (
    "Accurate: rates and energies within 5 %, means within 5 % of an sd, sds and quantiles within 10 % of an sd, "
    "skewness within 0.1, shares within 0.01, each with its whole interval (95 % simultaneous coverage over all rows "
    "of the table)."
)
"""What counts as accurate, as pages state it."""

RATES = ("rate", "energy", "power")


def laws(scene: Scene, closures: tuple[str, ...], a: Attractor | None = None) -> dict[str, Law | str]:
    """The stationary law of each closure, or the reason why it has none.

    Parameters
    ----------
    scene : Scene
        With its noise.
    closures : tuple of str
        Keys of `CLOSURES_JUDGED`.
    a : Attractor, optional
        Where the orbit ends; found if it is not given.

    Returns
    -------
    dict of str to Law or str
    """
    end = attractor(scene) if a is None else a
    by: dict[str, Callable[[], Law]] = {
        "saltation": lambda: linear_law(scene, end), "published": lambda: orbit_average(scene, "published"),
        "corrected": lambda: orbit_average(scene, "corrected"), "branching": lambda: branching_law(scene),
    }  # fmt: skip
    found: dict[str, Law | str] = {}
    for closure in closures:
        try:
            found[closure] = by[closure]()
        except NotPredicted as why:
            found[closure] = str(why)
    return found


def tolerance_of(name: str, values: dict[str, float]) -> float:
    """The largest error of a quantity that counts as accurate.

    Parameters
    ----------
    name : str
        The quantity.
    values : dict of str to float
        Simulated value of every quantity.

    Returns
    -------
    float
    """
    if name.startswith(RATES):
        return 0.05 * abs(values[name])
    if "share" in name:
        return 0.01
    if name.startswith("skew_"):
        return 0.1
    what = name.split("_", 1)[1] if name.startswith(("sd_", "q")) else name
    return (0.05 if what == name else 0.10) * values.get("sd_" + what, float("nan"))


def judged(run: LongRun, found: dict[str, Law | str]) -> pd.DataFrame:
    """Compare the laws of closures with a simulation.

    Parameters
    ----------
    run : LongRun
        The simulation.
    found : dict of str to Law or str
        From `laws`.

    Returns
    -------
    DataFrame
        Columns ``closure, kind, quantity, predicted, simulated, se, error, low, high, tolerance, verdict, reason``; the
        interval of the error holds the errors of both sides.
    """
    simulated = {name: e.value for name, e in run.estimates.items()}
    names = list(simulated)
    z = widest(len(names) * max(sum(isinstance(law, Law) for law in found.values()), 1))
    parts = []
    for closure, law in found.items():
        has = isinstance(law, Law)
        values = values_of(law, run.scene, run.slow) if isinstance(law, Law) else dict.fromkeys(names, np.nan)
        table = pd.DataFrame({
            "closure": closure, "kind": CLOSURES_JUDGED[closure], "quantity": names,
            "predicted": [values[n] for n in names], "simulated": [simulated[n] for n in names],
            "se": [run.estimates[n].se for n in names],
            "tolerance": [tolerance_of(n, simulated) for n in names], "paths": float(run.periods),
            "reason": "" if has else str(law),
        })  # fmt: skip
        own = law.se if isinstance(law, Law) else 0.0
        table["error"] = table["predicted"] - table["simulated"]
        table["noise"] = z * np.hypot(table["se"], own * table["predicted"].abs())
        table["low"], table["high"] = table["error"] - table["noise"], table["error"] + table["noise"]
        parts.append(judge(table).drop(columns=["noise", "paths"]).rename(columns={"paths_needed": "periods_needed"}))
    order = [
        "closure", "kind", "quantity", "predicted", "simulated", "se", "error", "low", "high", "tolerance", "verdict",
        "periods_needed", "reason",
    ]  # fmt: skip
    return pd.concat(parts, ignore_index=True)[order] if parts else pd.DataFrame(columns=order)
