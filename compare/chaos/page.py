"""The page and the folder of a study of chaos, with its answer in a few sentences."""

from typing import Any

import pandas as pd

from rattle.compare.chaos.exponents import NOISY_PATH, ORBIT, crossings, say_crossings, signs
from rattle.compare.chaos.figures import draw
from rattle.compare.chaos.measure import ChaosStudy
from rattle.compare.chaos.record import STICKS_AT_TIMES, STICKS_FOR_GOOD, STICKS_OFTEN
from rattle.compare.chaos.spectrum import spectra_tables
from rattle.compare.report.json_text import Facts
from rattle.compare.report.render import render_sentences
from rattle.compare.report.report import Report
from rattle.compare.report.texts import (
    glossary,
    name_wheels,
    read_texts,
)
from rattle.compare.validation.answer import explain_missing

CHAOS_CAPTIONS: dict[str, str] = read_texts("chaos")["figures"]
"""Captions of the figures, by name."""
CHAOS_PARQUET = ("sections", "spectra", "bifurcation")
"""Tables that are written as Parquet."""


def chaos_tables(study: ChaosStudy) -> dict[str, pd.DataFrame]:
    """Collect all tables.

    Returns: ``exponents, mean_maps``, and as far as they were measured ``sections, spectra, lines,
    spectra_summary, fsle`` (finite-size exponents), ``sqrt_law, sweep, crossings, bifurcation``.
    """
    tables = {
        "exponents": pd.concat([study.orbit.table, study.drift.table], ignore_index=True),
        "mean_maps": study.maps,
    }
    if study.sections:
        tables["sections"] = pd.concat(
            [s.table for s in study.sections.values()], ignore_index=True
        )
    if study.spectra:
        tables["spectra"], tables["lines"], tables["spectra_summary"] = spectra_tables(
            study.spectra
        )
    if study.finite_size is not None:
        tables["fsle"] = study.finite_size
    if study.law is not None:
        law = study.law
        tables["sqrt_law"] = law.table.assign(
            exponent=law.exponent, exponent_low=law.low, exponent_high=law.high
        )
    if study.sweep is not None:
        ofs = study.sweep["of"].unique()
        tables["sweep"] = study.sweep
        tables["crossings"] = pd.concat(
            [crossings(study.sweep, study.field, of) for of in ofs], ignore_index=True
        )
    if study.view is not None:
        tables["bifurcation"] = study.view.table
    return tables


def make_report(found: ChaosStudy, record: Facts) -> Report:
    """The report on a study of chaos."""
    tables = chaos_tables(found)
    known = tables["exponents"]
    return Report(
        "chaos",
        f"Chaos of {record['name']}",
        answer(found, tables),
        record,
        {
            "captions": CHAOS_CAPTIONS,
            "missing": found.missing,
            "field": found.field,
            **tables,
            "exponents": known[known["value"].notna() | (known["exponent"] == 1)],
        },
        glossary("chaos", gears=found.scene.gears),
        figures=draw(found),
        tables={name: table for name, table in tables.items() if name not in CHAOS_PARQUET},
        large={name: table for name, table in tables.items() if name in CHAOS_PARQUET},
        digits="%.10g",
    )


def _count(study: ChaosStudy, of: str, who: str) -> Facts:
    """At how many values of the field the largest exponent has which sign, and the motion
    sticks."""
    table = study.sweep
    assert table is not None
    rows = table[table["of"] == of]
    sign = signs(rows)
    kinds = rows["regime"].value_counts()
    return {
        "of": of,
        "who": who,
        "number": len(rows),
        "positive": (sign > 0).sum(),
        "negative": (sign < 0).sum(),
        "undecided": ((sign == 0) & rows["low"].notna()).sum(),
        "sticking": [
            f"{kind} at {kinds[kind]}"
            for kind in (STICKS_FOR_GOOD, STICKS_OFTEN, STICKS_AT_TIMES)
            if kind in kinds
        ],
        "changes": say_crossings(table, study.field, of),
    }


def answer(study: ChaosStudy, tables: dict[str, pd.DataFrame]) -> list[str]:
    """Summarise a study of chaos in sentences."""
    movers = {ORBIT: "the orbit", NOISY_PATH: "the noisy path"}
    names_by_reason: dict[str, list[str]] = {}
    for name, reason in study.missing.items():
        names_by_reason.setdefault(reason, []).append(name)
    sentences = render_sentences(
        "chaos/answer.j2",
        study.scene.words,
        study=study,
        maps=_records(study.maps),
        sizes=_records(study.finite_size),
        spectra=_records(tables.get("spectra_summary")),
        sweeps=[_count(study, *mover) for mover in movers.items() if study.sweep is not None],
        missing=names_by_reason,
    )
    missing = explain_missing(study.scene, list(study.maps["closure"]))
    return sentences + missing + name_wheels(study.scene)


def _records(table: pd.DataFrame | None) -> list[Any]:
    """The rows of a table, none where it was not measured."""
    return [] if table is None else table.to_dict("records")
