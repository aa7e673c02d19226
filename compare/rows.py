"""What the page of a report tabulates, as rows of text."""

from typing import Any

import pandas as pd

from compare.distance import section_distances
from compare.frontier import CAUSES
from compare.moments import VERDICTS
from compare.realizability import first_failures, realizability_table
from compare.validation import Validation

__all__ = [
    "MARKS", "count_rows", "distance_rows", "failure_rows", "frontier_rows", "impact_rows", "simulation_text",
    "speed_rows",
]  # fmt: skip

MARKS = {"accurate": "✓", "inaccurate": "✗", "undecided": "?", "not predicted": "–"}
SHOWN = [("mean", "tau"), ("mean", "y1"), ("mean", "y2"), ("sd", "tau"), ("sd", "y1"), ("sd", "y2")]
"""Section moments that the page tabulates; the table files hold all of them."""


def count_rows(v: Validation) -> list[dict[str, Any]]:
    """How many moments of each kind have each verdict, by reading."""
    rows = []
    for (reading, kind, moment), group in v.table.groupby(["reading", "kind", "moment"], sort=False):
        name = "ρ at mid-flight" if kind == "clock" else f"section {moment}s"
        rows.append({"reading": reading, "what": name, **{w: int((group["verdict"] == w).sum()) for w in VERDICTS}})
    return rows


def _cell(row: pd.Series) -> dict[str, str]:
    if row["verdict"] == "not predicted":
        return {"text": "–", "verdict": "not predicted"}
    unit = row["unit"] if row["unit"] > 0.0 else 1.0
    error, half = row["error"] / unit, 0.5 * (row["high"] - row["low"]) / unit
    text = f"{error:+.3f} ± {half:.3f}" if abs(error) < 1e3 else f"{error:+.2g} ± {half:.2g}"
    return {"text": text, "verdict": str(row["verdict"])}


def impact_rows(v: Validation, reading: str) -> dict[str, Any]:
    """Errors of a reading per impact, with the heads of their columns."""
    table = v.table[(v.table["reading"] == reading) & (v.table["kind"] == "section")]
    columns = [(m, q) for m, q in SHOWN if v.scene.stages == 2 or q != "y2"]
    cells = {(r["moment"], r["quantity"], r["impact"]): _cell(r) for _, r in table.iterrows()}
    section = v.closures[reading].section
    rows = []
    for impact in section.index:
        row = section.loc[impact]
        rhos = [
            f"{row[f'rho{s}']:.3f}" if row[f"rho{s}"] == row[f"rho{s}"] else "–" for s in range(1, v.scene.stages + 1)
        ]
        rows.append(
            {
                "impact": int(impact),
                "agreement": f"{v.run.agreement[reading].loc[impact]:.3f}",
                "cells": [cells[m, q, impact] for m, q in columns],
                "rhos": rhos,
                "realizable": bool(row["realizable"]),
            }
        )
    heads = [f"{'E' if m == 'mean' else 'sd'} {q}" for m, q in columns]
    rhos = [f"ρ{s}" for s in range(1, v.scene.stages + 1)]
    return {"reading": reading, "heads": heads, "rhos": rhos, "rows": rows, "stopped": v.closures[reading].stopped}


def failure_rows(v: Validation) -> list[dict[str, str]]:
    """First failure of each check of realizability."""
    failures = first_failures(realizability_table([m for m in v.closures.values() if m.trace.parts is None]))
    return [
        {
            "reading": str(row["reading"]),
            "check": str(row["check"]),
            "where": f"impact {row['impact']}, " + (f"stage {row['stage']}" if row["stage"] else "both stages"),
            "value": f"{row['value']:.3g}",
            "excess": f"{row['excess']:.3g}",
        }
        for _, row in failures.iterrows()
    ]


def distance_rows(v: Validation) -> list[dict[str, str]]:
    """Distances between section density and histogram in units of their sampling floors, by reading."""
    table = pd.concat([section_distances(m, v.run) for m in v.closures.values()], ignore_index=True)
    rows = []
    for reading, group in table.groupby("reading", sort=False):
        row = {"reading": str(reading)}
        for name in ("kolmogorov", "total_variation"):
            ratio = group[name] / group[f"{name}_floor"]
            row[name], row[f"worst_{name}"] = f"{ratio.median():.2g}", f"{ratio.max():.3g}"
        rows.append(row)
    return rows


def frontier_rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Frontiers by reading, neighbouring noise intensities with the same frontier and cause in one row."""
    rows = []
    for reading, group in table.groupby("reading", sort=False):
        group = group.sort_values("sigma")
        found = group[["accurate", "not_refuted", "cause"]]
        for _, same in group.groupby((found != found.shift()).any(axis=1).cumsum()):
            first, last = same.iloc[0], same.iloc[-1]
            sigma = f"{first['sigma']:.4g}" + (f" – {last['sigma']:.4g}" if len(same) > 1 else "")
            why = first["why"] if same["why"].nunique() == 1 else CAUSES[first["cause"]]
            reached = {name: int(first[name]) for name in ("accurate", "not_refuted")}
            rows.append({"reading": reading, "sigma": sigma, **reached, "why": why})
    return rows


def speed_rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Speed-ups as text; an error that its interval does not tell from zero is an upper bound, its speed-up a lower."""
    return [
        {
            "reading": row["reading"],
            "sigma": f"{row['sigma']:.4g}",
            "impacts": int(row["impacts"]),
            "worst": ("" if row["resolved"] else "≤ ") + f"{row['worst']:.4f}",
            "median": f"{row['median']:.4f}",
            "closure": f"{1e3 * row['closure_seconds']:.2f} ms",
            "monte_carlo": f"{1e3 * row['monte_carlo_seconds']:.3g} ms",
            "how": f"{row['paths']:,} paths",
            "speed_up": ("" if row["resolved"] else "≥ ") + f"{float(format(row['speed_up'], '.2g')):g}",
        }
        for _, row in table.sort_values(["reading", "sigma"]).iterrows()
    ]


def simulation_text(v: Validation) -> str:
    """How a validation was simulated, and what that leaves open."""
    run = v.run
    mean = v.run.section
    beside = " (2 dt and 4 dt on the same noise)" if "fine_coarse" in run.result.sums else ", no bias in the step"
    share = float((mean["se_tau"] / mean["sd_tau"]).median()) if v.scene.sigma > 0 else 0.0
    text = (
        f"{run.paths:,} paths of the {run.scheme} scheme, dt = {run.dt:.4g}{beside}; sampling "
        f"error of E τ {share:.2%} of its sd at the median impact; intervals of {v.z:.2f} standard errors, so that "
        f"all of them hold together with 95 %. They speak of the itineraries that were seen: one that fewer than 1 in "
        f"{run.paths / 3:,.0f} paths take may have been missed."
    )
    if run.unfinished:
        text += f" {run.unfinished:,} paths had not had all their impacts at the horizon."
    if run.held:
        text += f" In {run.held:,} steps impacts accumulated and the path was held to the end of the step."
    return text
