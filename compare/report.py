"""The report of a validation: a folder with one page in two forms, figures, tables and a manifest."""

import base64
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd

from compare import manifest
from compare.answer import answer, correlation_claim, sigma_text
from compare.distance import section_distances
from compare.folder import whole_folder
from compare.frontier import frontiers
from compare.moments import VERDICTS
from compare.plots import FIGURES, agreement_figure, frontier_figure, save
from compare.realizability import first_failures, realizability_table
from compare.validate import Validation

__all__ = ["CONTENTS", "table_text", "write_report"]

CONTENTS = frozenset(
    {"report.md", "report.html", "table.csv", "table.parquet", "correlation.csv", "manifest.json", "figures"}
)
"""What a report folder holds; anything else in it is not ours."""

MARKS = {"accurate": "✓", "inaccurate": "✗", "undecided": "?", "not predicted": "–"}
SHOWN = [("mean", "tau"), ("mean", "y1"), ("mean", "y2"), ("sd", "tau"), ("sd", "y1"), ("sd", "y2")]
"""Section moments that the page tabulates; the table files hold all of them."""

FRONTIER = (
    "How far each reading can be believed: the impact up to which every section mean and sd that it predicts is "
    "accurate (filled) or at least not refuted (hatched, number)."
)
AGREEMENT = (
    "Share of paths whose impacts so far had the meshes and sides of the closure's; no closure of a single orbit can "
    "hold beyond it. Dashed: the share that the branching reading predicts."
)


def _counts(v: Validation) -> list[dict[str, Any]]:
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


def _per_impact(v: Validation, reading: str) -> dict[str, Any]:
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


def _failure(row: pd.Series) -> dict[str, str]:
    """One first failure of realizability as text."""
    stage = f"stage {row['stage']}" if row["stage"] else "both stages"
    return {
        "reading": str(row["reading"]),
        "check": str(row["check"]),
        "where": f"impact {row['impact']}, {stage}",
        "value": f"{row['value']:.3g}",
        "excess": f"{row['excess']:.3g}",
    }


def _distances(v: Validation) -> list[dict[str, str]]:
    """Distances between section density and histogram in units of their sampling floors, by reading."""
    table = section_distances_of(v)
    rows = []
    for reading, group in table.groupby("reading", sort=False):
        row = {"reading": str(reading)}
        for name in ("kolmogorov", "total_variation"):
            ratio = group[name] / group[f"{name}_floor"]
            row[name], row[f"worst_{name}"] = f"{ratio.median():.2g}", f"{ratio.max():.3g}"
        rows.append(row)
    return rows


def section_distances_of(v: Validation) -> pd.DataFrame:
    """Distances of all readings of a validation."""
    return pd.concat([section_distances(m, v.run) for m in v.closures.values()], ignore_index=True)


def _simulation(v: Validation) -> str:
    run = v.run
    mean = v.run.section
    share = float((mean["se_tau"] / mean["sd_tau"]).median()) if v.scene.sigma > 0 else 0.0
    text = (
        f"{run.paths:,} paths of the {run.scheme} scheme, dt = {run.dt:g} (2 dt and 4 dt on the same noise); sampling "
        f"error of E τ {share:.2%} of its sd at the median impact; intervals of {v.z:.2f} standard errors, so that "
        f"all of them hold together with 95 %. They speak of the itineraries that were seen: one that fewer than 1 in "
        f"{run.paths / 3:,.0f} paths take may have been missed."
    )
    if run.unfinished:
        text += f" {run.unfinished:,} paths had not had all their impacts at the horizon."
    if run.held:
        text += f" In {run.held:,} steps impacts accumulated and the path was held to the end of the step."
    return text


def table_text(validations: Sequence[Validation]) -> tuple[pd.DataFrame, str]:
    """All rows with their noise intensity, and the same as CSV text to the last bit."""
    table = pd.concat([v.table.assign(sigma=v.scene.sigma) for v in validations], ignore_index=True)
    table.insert(0, "sigma", table.pop("sigma"))
    return table, table.to_csv(index=False)


def _svg_uri(path: Path) -> str:
    return "data:image/svg+xml;base64," + base64.b64encode(path.read_bytes()).decode()


def write_report(
    out: Path,
    settings: manifest.Settings,
    validations: Sequence[Validation],
    provenance: dict[str, Any],
    overwrite: bool,
) -> dict[str, Any]:
    """Write the report folder, whole or not at all, and return its manifest.

    Raises
    ------
    OutputError
        If the folder holds other things, or an earlier report that may not be replaced.
    """
    table, text = table_text(validations)
    record = {"settings": settings.to_dict(), "table_sha256": manifest.digest(text), **provenance}
    record["answer"] = answer(validations)
    with whole_folder(out, CONTENTS, overwrite) as folder:
        (folder / "figures").mkdir()
        (folder / "table.csv").write_text(text, encoding="utf-8")
        table.to_parquet(folder / "table.parquet", index=False)
        pd.concat([v.correlation.assign(sigma=v.scene.sigma) for v in validations]).to_csv(
            folder / "correlation.csv", index=False
        )
        sections = []
        for number, v in enumerate(validations, start=1):
            figures = []
            for name, (draw, caption) in FIGURES.items():
                path = Path("figures") / f"{name}-{number}-sigma-{sigma_text(v)}.svg"
                save(draw(v), folder / path)
                figures.append({"path": str(path), "caption": caption, "uri": _svg_uri(folder / path)})
            failures = first_failures(realizability_table([m for m in v.closures.values() if m.trace.parts is None]))
            sections.append(
                {
                    "failures": [_failure(row) for _, row in failures.iterrows()],
                    "distances": _distances(v),
                    "sigma": sigma_text(v),
                    "counts": _counts(v),
                    "readings": [_per_impact(v, r) for r in v.closures],
                    "figures": figures,
                    "simulation": _simulation(v),
                }
            )
        overview = {}
        for name, figure, caption in (
            ("frontier", frontier_figure(validations), FRONTIER),
            ("agreement", agreement_figure(validations), AGREEMENT),
        ):
            path = Path("figures") / f"{name}.svg"
            save(figure, folder / path)
            overview[name] = {"path": str(path), "caption": caption, "uri": _svg_uri(folder / path)}
        content = {
            "name": settings.name,
            "answer": record["answer"],
            "sections": sections,
            "marks": MARKS,
            "verdicts": VERDICTS,
            "overview": overview,
            "frontiers": frontiers(list(validations)).to_dict("records"),
            "claim": correlation_claim(validations),
            "manifest": record,
            "scene_toml": validations[0].scene.to_toml(),
        }
        for page, escape in (("report.md", False), ("report.html", True)):
            environment = jinja2.Environment(
                loader=jinja2.PackageLoader("compare"),
                autoescape=escape,
                trim_blocks=True,
                lstrip_blocks=True,
                undefined=jinja2.StrictUndefined,
            )
            (folder / page).write_text(environment.get_template(page + ".j2").render(content), encoding="utf-8")
        (folder / "manifest.json").write_text(json.dumps(record, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    return record
