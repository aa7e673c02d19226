"""The messages of a test that fails or stays undecided."""

import math

import pandas as pd

from rattle.compare.study.cells import Sampled
from rattle.compare.thresholds.claim import Claim
from rattle.compare.thresholds.summary import decided_by

__all__ = ["deciding", "failure_text", "remedies", "row_table", "undecided_text"]

MARGIN = 2.0
"""Factor on the number of paths that should decide a test, since it is computed from an error that is itself random."""


def _signed(value: float) -> str:
    """Four decimals, or an exponent where these would be zeros."""
    return f"{value:+.4f}" if abs(value) >= 1e-3 or value == 0.0 else f"{value:+.0e}"


def row_table(rows: pd.DataFrame) -> str:
    """Format rows as an aligned table, with errors and intervals in sds of the quantity.

    Parameters
    ----------
    rows : DataFrame
        As of `rattle.compare.thresholds.judging.judged`.

    Returns
    -------
    str

    Examples
    --------
    >>> row = {"moment": "mean", "quantity": "y1", "impact": 2, "predicted": 1.13, "simulated": 1.03, "error": 0.1}
    >>> row |= {"low": 0.08, "high": 0.12, "tolerance": 0.005, "unit": 0.1, "agreement": 1.0, "outcome": "fail"}
    >>> print(row_table(pd.DataFrame([row])))
                 model simulated error/sd      low     high  allowed on itinerary
    E y1 at 2     1.13      1.03  +1.0000  +0.8000  +1.2000   0.0500       1.0000
    """
    unit = rows["unit"]
    shown = pd.DataFrame(
        {
            "model": rows["predicted"].map("{:.7g}".format),
            "simulated": rows["simulated"].map("{:.7g}".format),
            "error/sd": (rows["error"] / unit).map(_signed),
            "low": (rows["low"] / unit).map(_signed),
            "high": (rows["high"] / unit).map(_signed),
            "allowed": (rows["tolerance"] / unit).map(lambda v: _signed(v)[1:]),
            "on itinerary": rows["agreement"].map("{:.4f}".format),
        }
    )
    names = [f"{'E' if r.moment == 'mean' else 'sd'} {r.quantity} at {r.impact}" for r in rows.itertuples()]
    return shown.set_axis(names, axis=0).to_string(col_space=8)


def _means(rows: pd.DataFrame, run: Sampled, z: float) -> str:
    told = "".join(f"{r}\n" for r in dict.fromkeys(rows["remark"]) if r)
    return (
        f"{told}{run.paths} paths; intervals of {z:.2f} standard errors; errors in sds of the quantity, at each path's "
        f"own impact\n{row_table(rows)}"
    )


def failure_text(model: str, table: pd.DataFrame, run: Sampled, z: float) -> str:
    """Describe the rows that failed.

    Parameters
    ----------
    model : str
        Name of the closure or model.
    table : DataFrame
        As of `rattle.compare.thresholds.judging.judged`.
    run : Sampled
        The simulation.
    z : float
        Half width of the intervals in standard errors.

    Returns
    -------
    str
    """
    failed = table[table["outcome"] == "fail"]
    undecided = int((table["outcome"] == "undecided").sum())
    beside = f", {undecided} undecided" if undecided else ""
    return f"{model} exceeds the allowed error in {len(failed)} of {len(table)} rows{beside}\n{_means(failed, run, z)}"


def deciding(table: pd.DataFrame) -> float:
    """Estimate the number of paths that would decide every undecided row.

    Parameters
    ----------
    table : DataFrame
        As of `rattle.compare.thresholds.judging.judged`.

    Returns
    -------
    float
        Infinite if no number would; 0 if no row is undecided.
    """
    undecided = table.loc[table["outcome"] == "undecided", "paths_needed"]
    return float(undecided.fillna(math.inf).max()) if len(undecided) else 0.0


def undecided_text(model: str, table: pd.DataFrame, run: Sampled, z: float) -> str:
    """Describe the rows that are undecided, and the number of paths that would decide them.

    Parameters
    ----------
    model : str
        Name of the closure or model.
    table : DataFrame
        As of `rattle.compare.thresholds.judging.judged`.
    run : Sampled
        The simulation.
    z : float
        Half width of the intervals in standard errors.

    Returns
    -------
    str
    """
    rows = table[table["outcome"] == "undecided"]
    remedy = decided_by(deciding(table))
    return f"{model} is undecided in {len(rows)} of {len(table)} rows; {remedy}\n{_means(rows, run, z)}"


def remedies(table: pd.DataFrame, claim: Claim) -> str:
    """Describe what can be done about undecided rows.

    Parameters
    ----------
    table : DataFrame
        With ``outcome`` and ``paths_needed``.
    claim : Claim
        What the test says of a model.

    Returns
    -------
    str

    Examples
    --------
    >>> from pathlib import Path
    >>> from rattle.compare.thresholds.claim import read_claim
    >>> from rattle.scene import DAT21, Scene
    >>> claim = read_claim({"scene": Scene.from_gears(DAT21, sigma=0.1), "within": 0.01}, Path())
    >>> print(remedies(pd.DataFrame({"outcome": ["undecided"], "paths_needed": [410_000.0]}), claim))
    Undecided is not passed. Give it more paths (budget=820_000 in its marker, or --rattle-budget), allow a larger error
    (within), or let it be undecided (undecided="skip" in its marker, or --rattle-undecided=skip).
    """
    needed = MARGIN * deciding(table)
    if not math.isfinite(needed):
        more = ""
    elif claim.accuracy is not None:
        more = f"Ask for a smaller accuracy than {claim.accuracy:g}, allow"
    else:
        more = f"Give it more paths (budget={float(f'{needed:.2g}'):_.0f} in its marker, or --rattle-budget), allow"
    given = " or ".join(dict.fromkeys("within" if a.in_sd else "absolute" for a in claim.allowed.values()))
    return (
        f"Undecided is not passed. {more or 'Allow'} a larger error\n({given}), or let it be undecided "
        '(undecided="skip" in its marker, or --rattle-undecided=skip).'
    )
