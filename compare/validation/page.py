"""The report of a validation: a folder with its page, figures, tables and a manifest."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure as Drawing

from rattle.compare.report import MARKS as SIGNS
from rattle.compare.report import Block, Code, Figure, Page, PageSection, Text, manifest
from rattle.compare.report.folder import name_of
from rattle.compare.report.glossary import CLOSURE_TERMS, SECTION_TERMS, VERDICT_TERMS, glossary
from rattle.compare.report.provenance import command_line, provenance, source_of
from rattle.compare.report.save import contents, csv_text, save
from rattle.compare.report.style import caption_of
from rattle.compare.validation import tables
from rattle.compare.validation.answer import answer, correlation_claim, sigma_text
from rattle.compare.validation.comparison import Comparison, Sweep
from rattle.compare.validation.figures import (
    FIGURES,
    VALIDITY,
    agreement_figure,
    drive_figure,
    has_something,
    validity_figure,
)
from rattle.compare.validation.tables import SCHEMES_NOTE, motion_blocks, scheme_table
from rattle.compare.validation.verdict import NOT_JUDGED, RULE, Tolerances
from rattle.scene.parts import SINE_ALONE

CONTENTS = contents(
    "report",
    tables=("table", "correlation", "leaving", "validity", "speed", "simulation", "schemes"),
    large=("table", "validity"),
) | {"figures"}
"""Names of all files in a report folder; a folder with any other file is not overwritten."""

SPEED = (
    "Work of each closure up to the last impact at which it is accurate, compared with the cheapest simulation of the "
    "same accuracy: exact flights with a control variate, with so many paths that the 95 % simultaneous error bound of "
    "all moments is the closure's worst error (in sds of the quantity). Times are nominal, for one core: impacts, "
    "mixture components and path-steps are counted at a fixed cost each (`speed.csv`)."
)
NONE = "No closure is shown to be accurate up to the first impact at any of these noise intensities; {} undecided."
UNRESOLVED = " “≤”: the sample cannot tell the error from zero, so the speed-up is a lower bound."
TIMED = " The time of a closure of one's own is measured on this machine; it is not compared with counted work."
AGREEMENT = (
    "Share of paths whose impacts so far were at the meshes and sides of the closure's itinerary; a closure along a "
    "single orbit says nothing about the others."
)
FAILURES = (
    "First failure of each check of the closures' moments; “negative mass” judges the truncated series, "
    "not the moments."
)
LEAVING = (
    "How paths leave the itinerary of the orbit without noise: the impact at which they strike another wall than it "
    "does. Rare branches are found by a search along the orbit, and their probability from paths drawn near them; a "
    "branch that neither the search nor the simulation has found is not listed."
)
NO_BRANCH = (
    "No path leaves the itinerary of the orbit without noise, and the search along it finds no branch that one in a "
    "billion paths take."
)
DISTANCE = "Distance of the section densities from the histograms, in units of the distance due to sampling alone:"
WORDS = ("exact flight", "σ", "ρ1, ρ2", "stage", "agreement", "realizable")
DRIVE = "The driver's motion over a period, in units of that of one sine: the sum of its orders, and each of them."
PREDICTED = " Dashed: the share that the branching closure predicts."


def _add(drawings: dict[str, Drawing], drawing: Drawing, name: str, parts: Sequence[tuple[str, str]]) -> Figure:
    """Add a drawing to those that are to be written; the block that shows it."""
    drawings[f"figures/{name}"], caption = drawing, caption_of(drawing, parts)
    return Figure(f"figures/{name}.svg", caption, caption)


def _section(v: Comparison, number: int, drawings: dict[str, Drawing]) -> PageSection:
    """One noise intensity of the page; its figures are added to the drawings."""
    name, sigma = f"{number}-sigma-{sigma_text(v)}", f"σ = {sigma_text(v)}"
    figures = [
        _add(drawings, draw(v), f"{kind}-{name}", parts)
        for kind, (draw, parts) in FIGURES.items()
        if has_something(kind, v)
    ]
    failures = tables.failure_table(v)
    found: list[Block] = [Text(FAILURES, note=True), failures] if failures.rows else [Text("Every check holds.")]
    left = tables.leaving_table(v)
    leaving: list[Block] = [Text(LEAVING, note=True), left] if left.rows else [Text(NO_BRANCH)]
    errors: list[Block] = []
    for closure, prediction in v.predictions.items():
        errors.append(tables.impact_table(v, closure, f"Errors of the {closure} closure per impact, {sigma}"))
        if prediction.stopped:
            errors.append(Text(f"The {closure} closure cannot be continued: {prediction.stopped}.", note=True))
    return PageSection(
        sigma,
        (
            Text(tables.simulation_text(v), note=True),
            tables.reach_table(v),
            tables.count_table(v),
            *motion_blocks(v),
            *figures,
        ),
        (
            PageSection(f"Leaving the itinerary at {sigma}", tuple(leaving)),
            PageSection(f"Realizability at {sigma}", (*found, Text(DISTANCE, note=True), tables.distance_table(v))),
            PageSection(f"Errors per impact at {sigma}", tuple(errors)),
        ),
    )


def _own_closures(v: Comparison) -> list[Block]:
    """What each closure of one's own is, where there is one."""
    found: list[Block] = []
    for name, prediction in v.predictions.items():
        if prediction.method.own:
            function = prediction.method.function
            meaning = (getattr(function, "__doc__", None) or "no description").strip().split("\n")[0]
            where = f" (`{prediction.method.reference}`)" if prediction.method.reference else ""
            digest = prediction.method.digest[:12]
            found.append(Text(f"`{name}`{where} is a closure of one's own, source {digest}: {meaning}", note=True))
    return found


def _page(
    settings: manifest.ReportSettings,
    validations: Sequence[Comparison],
    swept: Sweep | None,
    record: dict[str, Any],
    drawings: dict[str, Drawing],
    schemes: pd.DataFrame | None,
) -> Page:
    """The page of the report; its figures are added to the drawings."""
    caption = AGREEMENT + (PREDICTED if "branching" in validations[0].predictions else "")
    agreement = _add(drawings, agreement_figure(validations), "agreement", ((caption, ""),))
    own = _own_closures(validations[0])
    words = glossary(*CLOSURE_TERMS, *SECTION_TERMS, *VERDICT_TERMS, *WORDS, gears=validations[0].scene.gears)
    if swept:
        paths = (
            f"{settings.validity_paths:,} paths of exact flights at each σ (no step bias), all with the same random "
            "numbers. Each σ: `validity.csv`; what a simulation takes there: `simulation.csv`."
        )
        figure = _add(drawings, validity_figure(swept.validity, settings.impacts), "validity", VALIDITY)
        opening: tuple[Block, ...] = (
            figure,
            tables.validity_table(swept.validity),
            Text(paths, note=True),
            *own,
            words,
        )
        speeds = tables.speed_table(swept.speed)
        note = SPEED + ("" if swept.speed["resolved"].all() else UNRESOLVED)
        note += TIMED if swept.speed["speed_up"].isna().any() else ""
        none = NONE.format("some are" if (swept.validity["not_inaccurate"] > 0).any() else "none is")
        blocks = (Text(note, note=True), speeds) if speeds.rows else (Text(none),)
        sections = [
            PageSection("Speed-up of each closure where it is accurate", blocks),
            PageSection("How long the paths follow the itinerary", (agreement,)),
        ]
    else:
        opening, sections = (agreement, *own, words), []
    marks = ", ".join(
        f"{SIGNS[mark] or '–'} {verdict}" for verdict, mark in tables.MARKS.items() if verdict != NOT_JUDGED
    )
    legend = (
        f"Marks: {marks}. Errors are closure minus simulation, corrected for the measured step bias, in units of the "
        f"quantity's standard deviation, with the half width of their interval. {RULE}"
    )
    if schemes is not None:
        ensembles: list[Block] = [Text(SCHEMES_NOTE.format(schemes["paths"].max()), note=True)]
        for v in validations:
            ensembles += [Text(f"At σ = {sigma_text(v)}:"), scheme_table(schemes, v.scene.sigma)]
        sections.append(PageSection("Euler–Maruyama beside exact flights and the closures", tuple(ensembles)))
    if claim := correlation_claim(validations):
        sections.append(PageSection("Does |ρ| > 1 show that the density is not Gaussian?", (Text(claim),)))
    sections.append(PageSection("How the tables are read", (Text(legend),)))
    sections += [_section(v, number, drawings) for number, v in enumerate(validations, start=1)]
    if validations[0].scene.drive != SINE_ALONE:
        shown = _add(drawings, drive_figure(validations[0].scene), "drive", ((DRIVE, ""),))
        sections.append(PageSection("The drive", (shown,)))
    scene = Code(validations[0].scene.to_toml(), "toml")
    files = {"table": record["table_sha256"], "validity": record["validity_sha256"]}
    digests = {f"`{name}.csv`": f"sha256 {digest}" for name, digest in files.items() if digest}
    source = source_of(record, (Text("The scene at its first noise intensity:"), scene), digests)
    return Page(
        f"Can the closure be believed? {settings.name}", tuple(record["answer"]), source, opening, tuple(sections)
    )


def write_report(
    out: Path,
    settings: manifest.ReportSettings,
    validations: Sequence[Comparison],
    swept: Sweep | None,
    origin: dict[str, Any],
    overwrite: bool,
    schemes: pd.DataFrame | None = None,
) -> dict[str, Any]:
    """Write the report folder, whole or not at all."""
    frames = {
        name: pd.concat([getattr(v, name).assign(sigma=v.scene.sigma) for v in validations])
        for name in ("table", "correlation")
    }
    frames["table"] = frames["table"][["sigma", *validations[0].table]]
    frames["leaving"] = pd.concat([v.run.leaving.assign(sigma=v.scene.sigma) for v in validations])
    frames |= swept._asdict() if swept else {}
    frames |= {} if schemes is None else {"schemes": schemes}
    digests = {
        name: manifest.digest(csv_text(frames[name], index=False)) for name in ("table", "validity") if name in frames
    }
    record = {
        "version": manifest.VERSION,
        "settings": settings.to_dict(),
        "table_sha256": digests["table"],
        "validity_sha256": digests.get("validity"),
        **origin,
        "answer": answer(validations, swept),
    }
    drawings: dict[str, Drawing] = {}
    page = _page(settings, validations, swept, record, drawings, schemes)
    save(out, "report", page, record, allowed=CONTENTS, figures=drawings, tables=frames, overwrite=overwrite)
    return record


def write_one(v: Comparison, out: Path, overwrite: bool) -> Path:
    """Write the report of a validation that was made in Python."""
    run, entropy, order = v.run, v.run.seed.entropy, next(iter(v.predictions.values())).order
    closures = tuple(m.method.reference if m.method.own else name for name, m in v.predictions.items())
    seed = entropy if isinstance(entropy, int) and not run.seed.spawn_key else None
    settings = manifest.ReportSettings(
        name_of(out), (v.scene,), run.impacts, run.paths, run.dt, run.scheme, seed or 0, order, closures
    )
    here = "validate(...).report(...), in Python"
    by_command = seed is not None and v.tolerances == Tolerances() and all(closures)
    again = command_line(["validate", "--repeat", str(out / "manifest.json")])
    origin = provenance() | {
        "command": here,
        "repeat": again if by_command else f"{here}, with the same seed and tolerances",
        "wall_seconds": round(run.wall_seconds, 1),
        "cpu_seconds": None,
    }
    write_report(out, settings, [v], None, origin, overwrite)
    return out / "report.html"
