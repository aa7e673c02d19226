"""The report of a validation: a folder with one page in two forms, figures, tables and a manifest."""

import base64
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd

from compare import manifest
from compare.correlation import SIMULATED, first_failure
from compare.folder import whole_folder
from compare.moments import VERDICTS
from compare.plots import FIGURES, agreement_figure, save
from compare.validate import Validation

__all__ = ["CONTENTS", "answer", "table_text", "write_report"]

CONTENTS = frozenset(
    {"report.md", "report.html", "table.csv", "table.parquet", "correlation.csv", "manifest.json", "figures"}
)
"""What a report folder holds; anything else in it is not ours."""

MARKS = {"accurate": "✓", "inaccurate": "✗", "undecided": "?", "not predicted": "–"}
SHOWN = [("mean", "tau"), ("mean", "y1"), ("mean", "y2"), ("sd", "tau"), ("sd", "y1"), ("sd", "y2")]
"""Section moments that the page tabulates; the table files hold all of them."""

AGREEMENT = (
    "Share of paths whose impacts so far had the meshes and sides of the closure's. "
    "No closure of a single orbit can hold beyond it."
)


def _listed(items: Sequence[str]) -> str:
    return items[0] if len(items) == 1 else ", ".join(items[:-1]) + " and " + items[-1]


def _sigma(v: Validation) -> str:
    return f"{v.scene.sigma:.4g}"


def answer(validations: Sequence[Validation]) -> list[str]:
    """The answer in three sentences: accuracy, realizability, agreement."""
    impacts = len(validations[0].run.section)
    tolerances = validations[0].tolerances
    accuracy, realizability = [], []
    for reading in validations[0].closures:
        shares, failures = [], []
        for v in validations:
            rows = v.table[(v.table["reading"] == reading) & (v.table["kind"] == "section")]
            predicted = rows[rows["verdict"] != "not predicted"]
            right = int((predicted["verdict"] == "accurate").sum())
            shares.append(f"{right} of {len(predicted)} at σ = {_sigma(v)}")
            failures.append(first_failure(v.correlation, reading))
        accuracy.append(f"the {reading} reading gets {_listed(shares)} right")
        broken = [(v, f) for v, f in zip(validations, failures, strict=True) if f]
        if not broken:
            realizability.append(f"the {reading} reading stays realizable")
        else:
            last, (impact, stage, why) = broken[-1]
            where = (
                "at every σ"
                if len({f[0] for _, f in broken}) == 1 and len(broken) == len(validations)
                else (f"at σ = {_listed([_sigma(v) for v, _ in broken])}")
            )
            realizability.append(
                f"the {reading} reading stops being realizable at impact {impact} {where} "
                f"(at σ = {_sigma(last)}, stage {stage}: {why})"
            )
    largest = max(
        (v.correlation.loc[v.correlation["reading"] == SIMULATED, "rho"].abs().max() for v in validations), default=0.0
    )
    agreement = []
    for v in validations:
        best = max(v.run.agreement[r].iloc[-1] for r in v.closures)
        agreement.append(f"{best:.1%} at σ = {_sigma(v)}")
    return [
        f"Of the section moments that it predicts over {impacts} impacts, {'; '.join(accuracy)} (within "
        f"{tolerances.mean:.0%} of an sd for means and {tolerances.sd:.0%} for sds, interval included).",
        f"As for the correlation coefficient, {'; '.join(realizability)}; in the simulation |ρ| never exceeds "
        f"{largest:.4f}.",
        f"After {impacts} impacts the share of paths that still follow the closure's itinerary is "
        f"{_listed(agreement)}: no closure of a single orbit can hold beyond it.",
    ]


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
                path = Path("figures") / f"{name}-{number}-sigma-{_sigma(v)}.svg"
                save(draw(v), folder / path)
                figures.append({"path": str(path), "caption": caption, "uri": _svg_uri(folder / path)})
            sections.append(
                {
                    "sigma": _sigma(v),
                    "counts": _counts(v),
                    "readings": [_per_impact(v, r) for r in v.closures],
                    "figures": figures,
                    "simulation": _simulation(v),
                }
            )
        path = Path("figures") / "agreement.svg"
        save(agreement_figure(validations), folder / path)
        content = {
            "name": settings.name,
            "answer": record["answer"],
            "sections": sections,
            "marks": MARKS,
            "verdicts": VERDICTS,
            "agreement": {"path": str(path), "caption": AGREEMENT, "uri": _svg_uri(folder / path)},
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
