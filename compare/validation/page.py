"""The report of a validation: a folder with its page, figures, tables and a manifest."""

from collections.abc import Mapping, Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
from matplotlib.figure import Figure as Drawing

from rattle.compare.report import MARKS as SIGNS
from rattle.compare.report import Block, Code, Figure, Page, PageSection, Text, manifest
from rattle.compare.report.folder import name_of
from rattle.compare.report.provenance import command_line, provenance, source_of
from rattle.compare.report.save import contents, csv_text, save
from rattle.compare.report.style import caption_of, render
from rattle.compare.report.texts import (
    CLOSURE_TERMS,
    SECTION_TERMS,
    VERDICT_TERMS,
    glossary,
    lay_out,
    read_texts,
)
from rattle.compare.validation import tables
from rattle.compare.validation.answer import answer, correlation_claim, sigma_text
from rattle.compare.validation.comparison import Comparison, Sweep
from rattle.compare.validation.figures import (
    FIGURES,
    agreement_figure,
    drive_figure,
    validity_figure,
)
from rattle.compare.validation.tables import motion_blocks
from rattle.compare.validation.verdict import MARKS, RULE, Tolerances
from rattle.scene.parts import SINE_ALONE

CONTENTS = contents(
    "report",
    tables=("table", "correlation", "leaving", "validity", "speed", "simulation", "schemes"),
    large=("table", "validity"),
) | {"figures"}
"""Names of all files in a report folder; a folder with any other file is not overwritten."""

TABLES = {"table": "table", "correlation": "correlation", "leaving": "run.leaving"}
"""Tables of a validation by the name of their file."""
WORDS = ("exact flight", "σ", "ρ1, ρ2", "stage", "agreement", "realizable")
CAPTIONS: dict[str, dict[str, str]] = read_texts("validation")
"""Of each figure the parts of its caption, with a word of the legend that each needs."""
UNRESOLVED = " “≤”: the sample cannot tell the error from zero, so the speed-up is a lower bound."
TIMED = (
    " The time of a closure of one's own is measured on this machine; it is not compared with"
    " counted work."
)


def _add(
    drawings: dict[str, Drawing], drawing: Drawing, name: str, parts: Mapping[str, str]
) -> Figure:
    """Add a drawing to those that are to be written; the block that shows it."""
    drawings[f"figures/{name}"], caption = drawing, caption_of(drawing, parts.items())
    return Figure(f"figures/{name}.svg", caption, caption)


class DrawnSection(NamedTuple):
    """One noise intensity of the page, and its figures as SVG by their names."""

    section: PageSection
    figures: dict[str, bytes]


def draw_sections(validations: Sequence[Comparison]) -> list[DrawnSection]:
    """The sections of the noise intensities: most of the work of a page, and done once for several
    of them."""
    return [_draw_section(v, number) for number, v in enumerate(validations, start=1)]


def _draw_section(v: Comparison, number: int) -> DrawnSection:
    drawings: dict[str, Drawing] = {}
    sigma = sigma_text(v)
    errors = list[Block]()
    for closure, prediction in v.predictions.items():
        errors.append(
            tables.impact_table(
                v, closure, f"Errors of the {closure} closure per impact, σ = {sigma}"
            )
        )
        if prediction.stopped:
            errors.append(
                Text(f"The {closure} closure cannot be continued: {prediction.stopped}.", note=True)
            )
    left = tables.list_leaving(v)
    failures = tables.find_failures(v)
    parts = {
        "reach": tables.find_reach(v),
        "counts": tables.count_verdicts(v),
        "motion": motion_blocks(v),
        "figures": [
            _add(drawings, figure, f"{kind}-{number}-sigma-{sigma}", CAPTIONS[kind])
            for kind, draw in FIGURES.items()
            if (figure := draw(v))
        ],
        **({"leaving": left} if len(left) else {"no_leaving": True}),
        **({"failures": failures} if len(failures) else {"no_failures": True}),
        "distances": tables.find_distances(v),
        "errors": errors,
    }
    values = {"sigma": sigma, "simulation": tables.simulation_text(v)}
    section = PageSection(
        f"σ = {sigma}", *lay_out("validation", parts, layout="sigma.md", **values)
    )
    return DrawnSection(section, {name: render(drawing) for name, drawing in drawings.items()})


def _own_closures(v: Comparison) -> list[Block]:
    """What each closure of one's own is, where there is one."""
    found: list[Block] = []
    for name, method in ((name, m.method) for name, m in v.predictions.items() if m.method.own):
        meaning = (
            (getattr(method.function, "__doc__", None) or "no description").strip().split("\n")[0]
        )
        where = f" (`{method.reference}`)" if method.reference else ""
        digest = method.digest[:12]
        found.append(
            Text(
                f"`{name}`{where} is a closure of one's own, source {digest}: {meaning}", note=True
            )
        )
    return found


def _page(
    settings: manifest.ReportSettings,
    validations: Sequence[Comparison],
    swept: Sweep | None,
    record: dict[str, Any],
    drawn: Sequence[DrawnSection],
    drawings: dict[str, Drawing],
    schemes: pd.DataFrame | None,
) -> Page:
    """The page of the report; its figures are added to the drawings."""
    first = validations[0]
    captions = {
        text: ""
        for text, word in CAPTIONS["agreement"].items()
        if not word or word in first.predictions
    }
    agreement = _add(drawings, agreement_figure(validations), "agreement", captions)
    words = glossary(
        *CLOSURE_TERMS, *SECTION_TERMS, *VERDICT_TERMS, *WORDS, gears=first.scene.gears
    )
    explained = [*_own_closures(first), words]
    parts = dict[str, Any]()
    marks = ", ".join(f"{SIGNS[m] or '–'} {verdict}" for verdict, m in MARKS.items())
    values: dict[str, Any] = {
        "rule": RULE,
        "marks": marks,
        "unresolved": "",
        "timed": "",
        "none": "",
    }
    values |= {
        "validity_paths": settings.validity_paths,
        "beside": 0 if schemes is None else schemes["paths"].max(),
    }
    if swept:
        figure = _add(
            drawings,
            validity_figure(swept.validity, settings.impacts),
            "validity",
            CAPTIONS["validity"],
        )
        parts |= {"validity_figure": figure, "validity": tables.merge_sigmas(swept.validity)}
        parts |= {
            "agreement": agreement,
            "own_and_words": explained,
            "speed": tables.speed_rows(swept.speed),
        }
        values |= {} if swept.speed["resolved"].all() else {"unresolved": UNRESOLVED}
        values |= {"timed": TIMED} if swept.speed["speed_up"].isna().any() else {}
        if swept.speed.empty:
            values["none"] = (
                "some are" if (swept.validity["not_inaccurate"] > 0).any() else "none is"
            )
            parts |= {"speed": (), "no_speed": True}
    else:
        parts |= {"agreement_alone": agreement, "words_alone": explained}
    if schemes is not None:
        at = (
            (Text(f"At σ = {sigma_text(v)}:"), tables.scheme_table(schemes, v.scene.sigma))
            for v in validations
        )
        parts["schemes"] = [block for pair in at for block in pair]
    if claim := correlation_claim(validations):
        parts["claim"] = Text(claim)
    opening, sections = lay_out("validation", parts, **values)
    sections += tuple(one.section for one in drawn)
    if first.scene.drive != SINE_ALONE:
        shown = _add(drawings, drive_figure(first.scene), "drive", CAPTIONS["drive"])
        sections += (PageSection("The drive", (shown,)),)
    scene = Code(first.scene.to_toml(), "toml")
    files = {"table": record["table_sha256"], "validity": record["validity_sha256"]}
    digests = {f"`{name}.csv`": f"sha256 {digest}" for name, digest in files.items() if digest}
    source = source_of(record, (Text("The scene at its first noise intensity:"), scene), digests)
    return Page(
        f"Can the closure be believed? {settings.name}",
        tuple(record["answer"]),
        source,
        opening,
        sections,
    )


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
    origin: dict[str, Any],
    overwrite: bool,
    schemes: pd.DataFrame | None = None,
) -> dict[str, Any]:
    """Write the report folder, whole or not at all.

    `said`: Its answer in sentences. `drawn`: `draw_sections` of the validations.
    """
    own = {name: attrgetter(place) for name, place in TABLES.items()}
    frames = {
        n: pd.concat([table(v).assign(sigma=v.scene.sigma) for v in validations])
        for n, table in own.items()
    }
    frames["table"] = all_rows(validations)
    if swept:
        frames |= {name: getattr(swept, name) for name in ("validity", "speed", "simulation")}
    frames |= {} if schemes is None else {"schemes": schemes}
    digests = {
        f"{name}_sha256": (
            manifest.digest(csv_text(frames[name], index=False)) if name in frames else None
        )
        for name in ("table", "validity")
    }
    record = {"version": manifest.VERSION, "settings": settings.to_dict(), **digests, **origin}
    record["answer"] = list(said)
    drawings: dict[str, Drawing] = {}
    page = _page(settings, validations, swept, record, drawn, drawings, schemes)
    figures: dict[str, Drawing | bytes] = {**drawings}
    for one in drawn:
        figures |= one.figures
    save(
        out,
        "report",
        page,
        record,
        allowed=CONTENTS,
        figures=figures,
        tables=frames,
        overwrite=overwrite,
    )
    return record


def write_one(v: Comparison, out: Path, overwrite: bool) -> Path:
    """Write the report of a validation that was made in Python."""
    run = v.run
    entropy = v.run.seed.entropy
    order = next(iter(v.predictions.values())).order
    closures = tuple(
        m.method.reference if m.method.own else name for name, m in v.predictions.items()
    )
    seed = entropy if isinstance(entropy, int) and not run.seed.spawn_key else None
    settings = manifest.ReportSettings(
        name_of(out),
        (v.scene,),
        run.impacts,
        run.paths,
        run.dt,
        run.scheme,
        seed or 0,
        order,
        closures,
    )
    here = "validate(...).report(...), in Python"
    again = command_line(["validate", "--repeat", str(out / "manifest.json")])
    if seed is None or v.tolerances != Tolerances() or not all(closures):
        again = f"{here}, with the same seed and tolerances"
    time = {"wall_seconds": round(run.wall_seconds, 1), "cpu_seconds": None}
    origin = provenance() | {"command": here, "repeat": again, **time}
    write_report(out, settings, [v], None, answer([v]), draw_sections([v]), origin, overwrite)
    return out / "report.html"
