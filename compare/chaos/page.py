"""The page and the folder of a study of chaos."""

from pathlib import Path
from typing import Any

import pandas as pd

from rattle.compare.chaos.answer import answer
from rattle.compare.chaos.figures import draw
from rattle.compare.chaos.measure import ChaosStudy
from rattle.compare.chaos.spectrum import spectra_tables
from rattle.compare.chaos.sweep import crossings
from rattle.compare.report import Block, Figure, Page, PageSection, Text
from rattle.compare.report.frames import table_of
from rattle.compare.report.glossary import CHAOS_TERMS, CLOSURE_TERMS, SECTION_TERMS, glossary
from rattle.compare.report.provenance import source_of
from rattle.compare.report.save import contents, save

FIGURES = {
    "section": "Poincaré sections at the impacts, in the paper's coordinates: flight time against velocity just before "
    "the impact, as densities on the same axes; orbit, mean map and noisy system.",
    "spectra": "Power spectra of the velocities with 95 % intervals, the continuous floor, and the bands above it.",
    "sweep": "Largest exponent over the field with its 95 % interval: of the orbit, and of the drift's linearisation "
    "along noisy paths; where the orbit sticks, and the range that the paper claims to be chaotic.",
    "bifurcation": "Bifurcation diagram: points of the section over the field as densities, with the largest exponents "
    "below.",
    "finite_size": "Finite-size exponent of the noisy system over the distance of two paths on the same noise: it "
    "grows without bound as the distance decreases, so there is no infinitesimal exponent.",
    "sqrt_law": "Distance of two paths on the same noise after an impact over their distance before it, with the "
    "square-root law.",
}
"""Captions of the figures, by name."""
TABLES = ("exponents", "mean_maps", "lines", "spectra_summary", "fsle", "sqrt_law", "sweep", "crossings")
LARGE = ("sections", "spectra", "bifurcation")
CONTENTS = contents("chaos", figures=tuple(FIGURES), tables=TABLES, large=LARGE)
"""Files of such a folder; a folder with any other file is not overwritten."""
WORDS = (*CLOSURE_TERMS, *SECTION_TERMS, *CHAOS_TERMS, "Δτ", "σ", "α", "ε", "realizable")


def chaos_tables(study: ChaosStudy) -> dict[str, pd.DataFrame]:
    """Collect all tables.

    Returns: ``exponents, mean_maps``, and as far as they were measured ``sections, spectra, lines,
    spectra_summary, fsle`` (finite-size exponents), ``sqrt_law, sweep, crossings, bifurcation``.
    """
    exponents = pd.concat([study.orbit.table, study.drift.table], ignore_index=True)
    found = {"exponents": exponents, "mean_maps": study.maps}
    if study.sections:
        found["sections"] = pd.concat([s.table for s in study.sections.values()], ignore_index=True)
    if study.spectra:
        found["spectra"], found["lines"], found["spectra_summary"] = spectra_tables(study.spectra)
    if study.finite_size is not None:
        found["fsle"] = study.finite_size
    if study.law is not None:
        found["sqrt_law"] = study.law.table.assign(
            exponent=study.law.exponent, exponent_low=study.law.low, exponent_high=study.law.high
        )
    if study.sweep is not None:
        ofs = study.sweep["of"].unique()
        found["sweep"] = study.sweep
        found["crossings"] = pd.concat([crossings(study.sweep, study.field, of) for of in ofs], ignore_index=True)
    if study.view is not None:
        found["bifurcation"] = study.view.table
    return found


def chaos_page(found: ChaosStudy, record: dict[str, Any], drawn: list[str]) -> Page:
    """Build the page of a study of chaos."""
    tables = chaos_tables(found)
    figures = {name: Figure(f"{name}.svg", FIGURES[name], FIGURES[name]) for name in drawn}
    shown = ["of", "exponent", "value", "low", "high", "rate", "sum_error", "impacts", "reason"]
    exponents = table_of(tables["exponents"][shown], ("of", "reason"))
    shown = ["closure", "map", "exponents", "not_realizable", "ends", "moments"]
    maps = table_of(tables["mean_maps"][shown], ("closure", "map", "exponents", "moments"))
    key = "section" if found.sweep is None else "sweep"
    opening: tuple[Block, ...] = (
        *(figures[n] for n in (key,) if n in figures),
        exponents,
        Text(
            "Lyapunov exponents per unit of dimensionless time, by the QR method, with 95 % intervals from batch "
            "means. `sum_error` is their sum less its exact value −(β1 + β2) + rate · 2 ln ε.",
            True,
        ),
        glossary(*WORDS, gears=found.scene.gears),
    )
    said = Text("The map that each closure iterates, and which exponents its means have.", True)
    parts = [PageSection("The mean maps", (said, maps))]

    def explain_missing(part: str) -> list[Block]:
        return [Text(f"Left out: {what} ({why}).") for what, why in found.missing.items() if part in what]

    if found.sweep is not None:
        blocks = explain_missing("bifurcation") + [figures[n] for n in ("bifurcation",) if n in figures]
        crossings = table_of(tables["crossings"], ("of",))
        rows = table_of(tables["sweep"], ("of", "regime", "reason"), summary=f"All values of {found.field}")
        said = Text(f"Where the largest exponent changes its sign over {found.field}: between `low` and `high`.", True)
        parts.append(PageSection(f"Over {found.field}", (*blocks, said, crossings, rows)))
    sections: list[Block] = [figures["section"]] if key != "section" and "section" in figures else []
    sections += explain_missing("Poincaré")
    if sections:
        parts.append(PageSection("Poincaré sections", tuple(sections)))
    spectra = explain_missing("spectra")
    if found.spectra:
        shown = ["side", "kind", "velocity", "frequency", "width", "share", "over", "narrow"]
        spectra += [
            figures["spectra"],
            Text(
                "`floor_share` is the share of the continuous part in the power, `narrow` the number of bands no "
                "wider than a single frequency. False-alarm probability: 1 % for each spectrum.",
                True,
            ),
            table_of(tables["spectra_summary"], ("side", "kind", "velocity")),
            table_of(tables["lines"][shown], ("side", "kind", "velocity", "narrow"), summary="All bands"),
        ]
    parts.append(PageSection("Spectra", tuple(spectra)))
    apart: list[Block] = [figures[n] for n in ("finite_size", "sqrt_law") if n in figures]
    apart += explain_missing("square-root") + explain_missing("finite-size")
    if found.finite_size is not None:
        apart.append(table_of(found.finite_size, summary="All distances"))
    parts.append(PageSection("Two paths on the same noise", tuple(apart)))
    return Page(f"Chaos of {record['name']}", tuple(answer(found)), source_of(record), opening, tuple(parts))


def write_chaos(out: Path, found: ChaosStudy, record: dict[str, Any], overwrite: bool) -> list[str]:
    """Write the folder of a study of chaos."""
    figures = draw(found)
    page = chaos_page(found, record, list(figures))
    save(
        out,
        "chaos",
        page,
        record,
        allowed=CONTENTS,
        figures=figures,
        tables=chaos_tables(found),
        digits="%.10g",
        overwrite=overwrite,
    )
    return list(page.answer)
