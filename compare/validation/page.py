"""The report of a validation: a folder with its page, figures, tables and a manifest."""

from collections.abc import Mapping, Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
from matplotlib.figure import Figure

from rattle.compare.judge.verdict import MARKS, Tolerances
from rattle.compare.report import manifest
from rattle.compare.report.folder import name_of
from rattle.compare.report.json_text import Facts
from rattle.compare.report.provenance import command_line, provenance
from rattle.compare.report.report import Report
from rattle.compare.report.save import csv_text, save
from rattle.compare.report.style import caption_of, render
from rattle.compare.report.table import SIGNS_OF_MARKS
from rattle.compare.report.texts import (
    glossary,
    read_texts,
)
from rattle.compare.validation import tables
from rattle.compare.validation.answer import answer, correlation_claim, sigma_text
from rattle.compare.validation.comparison import Comparison, Sweep
from rattle.compare.validation.errors import RULE
from rattle.compare.validation.figures import (
    VALIDATION_FIGURES,
    agreement_figure,
    drive_figure,
    validity_figure,
)
from rattle.scene.parts import SINE_ALONE

VALIDATION_TABLES = {
    "table": attrgetter("table"),
    "correlation": attrgetter("correlation"),
    "leaving": attrgetter("run.leaving"),
}
"""Tables of a validation by the name of their file."""
VALIDATION_PARQUET = ("table", "validity")
"""Tables that are written as Parquet too."""
CAPTIONS: dict[str, dict[str, str]] = read_texts("validation")
"""Of each figure the parts of its caption, with a word of the legend that each needs."""


class DrawnSection(NamedTuple):
    """One noise intensity of the page, and its figures as SVG by their names."""

    content: Facts
    figures: dict[str, bytes]


def draw_sections(validations: Sequence[Comparison]) -> list[DrawnSection]:
    """The sections of the noise intensities: most of the work of a page, and done once for several
    of them."""
    return [_draw_section(v, number) for number, v in enumerate(validations, start=1)]


def _draw_section(v: Comparison, number: int) -> DrawnSection:
    sigma = sigma_text(v)
    figures: dict[str, bytes] = {}
    captions: dict[str, str] = {}
    for kind, draw in VALIDATION_FIGURES.items():
        if figure := draw(v):
            name = f"figures/{kind}-{number}-sigma-{sigma}"
            figures[name] = render(figure)
            captions[name] = caption_of(figure, CAPTIONS[kind].items())
    content: Facts = {
        "sigma": sigma,
        "simulation": tables.simulation_text(v),
        "reach": tables.find_reach(v),
        "counts": tables.count_verdicts(v),
        "captions": captions,
        "leaving": tables.list_leaving(v),
        "failures": tables.find_failures(v),
        "distances": tables.find_distances(v),
        "errors": {closure: tables.impact_table(v, closure) for closure in v.predictions},
        "stopped": {closure: prediction.stopped for closure, prediction in v.predictions.items()},
    }
    if v.scene.gears is not None:
        content["units"] = v.scene.gears.units
        content["motion"] = tables.motion_table(v)
        if len(v.run.at_times()):
            content["times"] = tables.time_table(v)
    return DrawnSection(content, figures)


def _draw(first: Comparison, validations: Sequence[Comparison], swept: Sweep | None) -> Any:
    """The figures of all noise intensities together, with the texts of their captions."""
    agreement = {
        text: ""
        for text, word in CAPTIONS["agreement"].items()
        if not word or word in first.predictions
    }
    drawn: dict[str, tuple[Figure, Mapping[str, str]]] = {
        "agreement": (agreement_figure(validations), agreement)
    }
    if swept:
        impacts = first.run.impacts
        drawn["validity"] = (validity_figure(swept.validity, impacts), CAPTIONS["validity"])
    if first.scene.drive != SINE_ALONE:
        drawn["drive"] = (drive_figure(first.scene), CAPTIONS["drive"])
    return drawn


def _fill(
    settings: manifest.ReportSettings,
    validations: Sequence[Comparison],
    swept: Sweep | None,
    schemes: pd.DataFrame | None,
) -> Facts:
    """What the template of the page shows besides the figures and the noise intensities."""
    first = validations[0]
    marks = [f"{SIGNS_OF_MARKS[mark] or '–'} {verdict}" for verdict, mark in MARKS.items()]
    content: Facts = {
        "swept": swept is not None,
        "predictions": first.predictions,
        "marks": ", ".join(marks),
        "rule": RULE,
        "claim": correlation_claim(validations),
        "scene": first.scene.to_toml(),
    }
    if swept:
        content["validity"] = tables.merge_sigmas(swept.validity)
        content["validity_paths"] = settings.validity_paths
        content["speed"] = tables.speed_rows(swept.speed)
    if schemes is not None:
        sampled = schemes["paths"] > 0
        shown = schemes.assign(paths=schemes["paths"].where(sampled))
        content["beside"] = schemes["paths"].max()
        content["schemes"] = [
            (sigma_text(v), shown[shown["sigma"] == v.scene.sigma]) for v in validations
        ]
    return content


def all_rows(validations: Sequence[Comparison]) -> pd.DataFrame:
    """The rows of all validations, the noise intensity first: the file ``table``."""
    rows = pd.concat([v.table.assign(sigma=v.scene.sigma) for v in validations])
    return rows[["sigma", *validations[0].table]]


def write_report(
    out: Path,
    settings: manifest.ReportSettings,
    validations: Sequence[Comparison],
    swept: Sweep | None,
    said: Sequence[str],
    drawn: Sequence[DrawnSection],
    origin: Facts,
    overwrite: bool,
    schemes: pd.DataFrame | None = None,
) -> Facts:
    """Write the report folder, whole or not at all.

    `said`: Its answer in sentences. `drawn`: `draw_sections` of the validations.
    """
    first = validations[0]
    frames = {
        name: pd.concat([table(v).assign(sigma=v.scene.sigma) for v in validations])
        for name, table in VALIDATION_TABLES.items()
    }
    frames["table"] = all_rows(validations)
    if swept:
        frames |= {name: getattr(swept, name) for name in ("validity", "speed", "simulation")}
    if schemes is not None:
        frames["schemes"] = schemes
    large = {name: frames[name] for name in VALIDATION_PARQUET if name in frames}
    digests = {name: manifest.digest(csv_text(table, index=False)) for name, table in large.items()}
    record = {
        "version": manifest.VERSION,
        "settings": settings.to_dict(),
        **{f"{name}_sha256": digests.get(name) for name in VALIDATION_PARQUET},
        **origin,
    }
    figures: dict[str, Figure | bytes] = {}
    captions: dict[str, str] = {}
    for name, (figure, parts) in _draw(first, validations, swept).items():
        figures[f"figures/{name}"] = figure
        captions[f"figures/{name}"] = caption_of(figure, parts.items())
    for section in drawn:
        figures |= section.figures
    content = _fill(settings, validations, swept, schemes)
    content["captions"] = captions
    content["validations"] = [section.content for section in drawn]
    report = Report(
        "report",
        f"Can the closure be believed? {settings.name}",
        said,
        record,
        content,
        glossary("validation", gears=first.scene.gears),
        figures=figures,
        tables=frames,
        large=large,
        template="validation/page.j2",
        spoken=first.scene.words,
        more={f"`{name}.csv`": f"sha256 {digest}" for name, digest in digests.items()},
    )
    save(out, report, overwrite)
    return record | {"answer": said}


def write_one(v: Comparison, out: Path, overwrite: bool) -> Path:
    """Write the report of a validation that was made in Python."""
    run = v.run
    entropy = run.seed.entropy
    first, *_ = v.predictions.values()
    closures = tuple(
        m.method.reference if m.method.own else name for name, m in v.predictions.items()
    )
    seed = entropy if isinstance(entropy, int) and not run.seed.spawn_key else None
    size = (run.impacts, run.paths, run.dt, run.scheme, seed or 0, first.order)
    settings = manifest.ReportSettings(name_of(out), (v.scene,), *size, closures)
    here = "validate(...).report(...), in Python"
    again = command_line(["validate", "--repeat", str(out / "manifest.json")])
    if seed is None or v.tolerances != Tolerances() or not all(closures):
        again = f"{here}, with the same seed and tolerances"
    time = {"wall_seconds": round(run.wall_seconds, 1), "cpu_seconds": None}
    origin = provenance() | {"command": here, "repeat": again, **time}
    write_report(out, settings, [v], None, answer([v]), draw_sections([v]), origin, overwrite)
    return out / "report.html"
