"""The report of a validation: a folder with one page in two forms, figures, tables and a manifest."""

import base64
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd
from matplotlib.figure import Figure

from compare import manifest
from compare.answer import answer, correlation_claim, sigma_text
from compare.folder import whole_folder
from compare.frontier import frontiers
from compare.frontier_plot import frontier_figure
from compare.moments import VERDICTS
from compare.plots import FIGURES, agreement_figure
from compare.rows import (
    MARKS,
    count_rows,
    distance_rows,
    failure_rows,
    frontier_rows,
    impact_rows,
    simulation_text,
    speed_rows,
)
from compare.style import save
from compare.sweep import Sweep
from compare.validation import Validation

__all__ = ["CONTENTS", "table_text", "write_report"]

CONTENTS = frozenset({
    "report.md", "report.html", "table.csv", "table.parquet", "correlation.csv", "frontier.csv", "frontier.parquet",
    "speed.csv", "manifest.json", "figures",
})  # fmt: skip
"""What a report folder holds; anything else in it is not ours."""

FRONTIER = (
    "How far each reading can be believed: the impact up to which every section mean and sd that it predicts is "
    "accurate (filled), and up to which none is refuted (hatched: undecided). A marker says what refutes it there."
)
AGREEMENT = (
    "Share of paths whose impacts so far had the meshes and sides of the closure's; no closure of a single orbit can "
    "hold beyond it. Dashed: the share that the branching reading predicts."
)


def table_text(validations: Sequence[Validation]) -> tuple[pd.DataFrame, str]:
    """All rows with their noise intensity, and the same as CSV text to the last bit."""
    table = pd.concat([v.table.assign(sigma=v.scene.sigma) for v in validations], ignore_index=True)
    table.insert(0, "sigma", table.pop("sigma"))
    return table, table.to_csv(index=False)


def _svg_uri(path: Path) -> str:
    return "data:image/svg+xml;base64," + base64.b64encode(path.read_bytes()).decode()


def _drawn(figure: Figure, name: str, caption: str, folder: Path) -> dict[str, str]:
    """Save a figure into the report folder; what the page needs to show it."""
    path = Path("figures") / f"{name}.svg"
    save(figure, folder / path)
    return {"path": str(path), "caption": caption, "uri": _svg_uri(folder / path)}


def _section(v: Validation, number: int, folder: Path) -> dict[str, Any]:
    """One noise intensity of the page, its figures saved."""
    name = f"{number}-sigma-{sigma_text(v)}"
    return {
        "sigma": sigma_text(v),
        "simulation": simulation_text(v),
        "frontiers": frontiers([v]).to_dict("records"),
        "counts": count_rows(v),
        "failures": failure_rows(v),
        "distances": distance_rows(v),
        "readings": [impact_rows(v, r) for r in v.closures],
        "figures": [_drawn(draw(v), f"{kind}-{name}", caption, folder) for kind, (draw, caption) in FIGURES.items()],
    }


def write_report(
    out: Path,
    settings: manifest.Settings,
    validations: Sequence[Validation],
    swept: Sweep | None,
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
    frontier_text = swept.frontier.to_csv(index=False) if swept else None
    record = {
        "settings": settings.to_dict(),
        "table_sha256": manifest.digest(text),
        "frontier_sha256": manifest.digest(frontier_text) if frontier_text else None,
        **provenance,
        "answer": answer(validations, swept.frontier if swept else None),
    }
    with whole_folder(out, CONTENTS, overwrite) as folder:
        (folder / "figures").mkdir()
        (folder / "table.csv").write_text(text, encoding="utf-8")
        table.to_parquet(folder / "table.parquet", index=False)
        pd.concat([v.correlation.assign(sigma=v.scene.sigma) for v in validations]).to_csv(
            folder / "correlation.csv", index=False
        )
        opening = None
        if swept and frontier_text:
            (folder / "frontier.csv").write_text(frontier_text, encoding="utf-8")
            swept.frontier.to_parquet(folder / "frontier.parquet", index=False)
            swept.speed.to_csv(folder / "speed.csv", index=False)
            opening = {
                "figure": _drawn(frontier_figure(swept.frontier, settings.impacts), "frontier", FRONTIER, folder),
                "frontiers": frontier_rows(swept.frontier),
                "speeds": speed_rows(swept.speed),
                "paths": f"{settings.frontier_paths:,}",
            }
        content = {
            "name": settings.name,
            "answer": record["answer"],
            "opening": opening,
            "agreement": _drawn(agreement_figure(validations), "agreement", AGREEMENT, folder),
            "sections": [_section(v, number, folder) for number, v in enumerate(validations, start=1)],
            "marks": MARKS,
            "verdicts": VERDICTS,
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
