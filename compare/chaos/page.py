"""The page and the folder of a study of chaos, with its answer in a few sentences."""

from typing import Any

import numpy as np
import pandas as pd

from rattle.compare.chaos.exponents import DRIFT, ORBIT, Exponents, crossings, say_crossings, signs
from rattle.compare.chaos.figures import draw
from rattle.compare.chaos.measure import ChaosStudy
from rattle.compare.chaos.record import STICKS_AT_TIMES, STICKS_FOR_GOOD, STICKS_OFTEN
from rattle.compare.chaos.spectrum import VELOCITY_IN_TIME, spectra_tables
from rattle.compare.report.report import Report
from rattle.compare.report.texts import (
    CHAOS_TERMS,
    CLOSURE_TERMS,
    SECTION_TERMS,
    glossary,
    read_texts,
)
from rattle.compare.validation.answer import explain_missing
from rattle.compare.validation.verdict import join_words

CHAOS_CAPTIONS: dict[str, str] = read_texts("chaos")["figures"]
"""Captions of the figures, by name."""
CHAOS_PARQUET = ("sections", "spectra", "bifurcation")
"""Tables that are written as Parquet."""
CHAOS_WORDS = (*CLOSURE_TERMS, *SECTION_TERMS, *CHAOS_TERMS, "Δτ", "σ", "α", "ε", "realizable")

ROUNDED_SUM = 1e-12  # a smaller error of the exponents' sum is rounding


def chaos_tables(study: ChaosStudy) -> dict[str, pd.DataFrame]:
    """Collect all tables.

    Returns: ``exponents, mean_maps``, and as far as they were measured ``sections, spectra, lines,
    spectra_summary, fsle`` (finite-size exponents), ``sqrt_law, sweep, crossings, bifurcation``.
    """
    found = {
        "exponents": pd.concat([study.orbit.table, study.drift.table], ignore_index=True),
        "mean_maps": study.maps,
    }
    if study.sections:
        found["sections"] = pd.concat([s.table for s in study.sections.values()], ignore_index=True)
    if study.spectra:
        found["spectra"], found["lines"], found["spectra_summary"] = spectra_tables(study.spectra)
    if study.finite_size is not None:
        found["fsle"] = study.finite_size
    if study.law is not None:
        law = study.law
        found["sqrt_law"] = law.table.assign(
            exponent=law.exponent, exponent_low=law.low, exponent_high=law.high
        )
    if study.sweep is not None:
        ofs = study.sweep["of"].unique()
        found["sweep"] = study.sweep
        found["crossings"] = pd.concat(
            [crossings(study.sweep, study.field, of) for of in ofs], ignore_index=True
        )
    if study.view is not None:
        found["bifurcation"] = study.view.table
    return found


def make_report(found: ChaosStudy, record: dict[str, Any]) -> Report:
    """The report on a study of chaos."""
    tables = chaos_tables(found)
    return Report(
        "chaos",
        f"Chaos of {record['name']}",
        answer(found, tables),
        record,
        {"captions": CHAOS_CAPTIONS, "missing": found.missing, "field": found.field, **tables},
        glossary(*CHAOS_WORDS, gears=found.scene.gears),
        figures=draw(found),
        tables={name: table for name, table in tables.items() if name not in CHAOS_PARQUET},
        large={name: table for name, table in tables.items() if name in CHAOS_PARQUET},
        digits="%.10g",
    )


def _exponents(e: Exponents, name: str) -> str:
    shown = ", ".join(f"{v:.4f} ± {h:.4f}" for v, h in zip(e.value, e.half, strict=True))
    if not np.isfinite(e.value[0]):
        return f"The {name} has no exponents: the path {e.regime.reason}."
    error = abs(e.sum_error)
    exact = "is the exact one, to rounding"
    if error >= ROUNDED_SUM:
        exact = f"differs from the exact one by {error:.0e}"
    return (
        f"The {name} has the exponents {shown} per unit of dimensionless time ({e.impacts:,}"
        f" impacts, {e.rate:.3f} a unit; their sum {exact}); it {e.regime.reason}."
    )


def _first(study: ChaosStudy) -> str:
    """Whether the motion without noise is chaotic, here and over the field."""
    gears = study.scene.gears
    value, low, high = study.orbit.largest
    found = f"largest Lyapunov exponent {value:.3g} ± {0.5 * (high - low):.1g}"
    if gears is not None:
        found += f" per unit of τ, {gears.omega * value:.3g} per second"
    if not np.isfinite(value):
        why = study.orbit.regime.reason
        said = f"Without noise this gear pair has no Lyapunov exponents: it {why}"
    elif low > 0.0:
        said = f"Without noise this gear pair rattles chaotically ({found})"
    elif high < 0.0:
        said = f"Without noise this gear pair rattles regularly, not chaotically ({found})"
    else:
        said = f"Whether this gear pair rattles chaotically without noise is undecided ({found})"
    if study.sweep is not None:
        rows = study.sweep[study.sweep["of"] == ORBIT]
        at = study.sweep[study.field]
        said += f"; over {study.field} from {at.min():.3g} to {at.max():.3g} it is chaotic at "
        said += f"{(signs(rows) > 0).sum()} of {len(rows)} values"
    return f"{said}."


def _maps(maps: pd.DataFrame) -> str:
    words = []
    for row in maps.to_dict("records"):
        said = "has the orbit's"
        if row["closure"] == "published":
            clauses = ["has no exponents"]
            if row["ends"] < row["followed"]:
                clauses.insert(0, f"ends at impact {row['ends']:g}")
            if np.isfinite(row["not_realizable"]):
                clauses.insert(0, f"is not realizable from impact {row['not_realizable']:g} on")
            said = join_words(clauses)
        elif np.isnan(row["largest"]):
            said = "has none, like the orbit"
        elif np.isfinite(row["too_wide"]):
            said += (
                f", and from impact {row['too_wide']:g} on its sd of y1 is larger than that of the"
                " whole orbit"
            )
        words.append(f"`{row['closure']}` {said}")
    lost = (
        " A closure whose sd is that large no longer locates the motion."
        if maps["too_wide"].notna().any()
        else ""
    )
    return f"Exponents of the mean maps: {'; '.join(words)}.{lost}"


def _sweep(table: pd.DataFrame, field: str, of: str, who: str) -> str:
    rows = table[table["of"] == of]
    found = signs(rows)
    counts = (
        (kind, (rows["regime"] == kind).sum())
        for kind in (STICKS_FOR_GOOD, STICKS_OFTEN, STICKS_AT_TIMES)
    )
    sticking = [f"{kind} at {n}" for kind, n in counts if n]
    marked = f"; {who} {join_words(sticking)}" if sticking else ""
    undecided = ((found == 0) & rows["low"].notna()).sum()
    return (
        f"Largest exponent, {of}: positive at {(found > 0).sum()}, negative at {(found < 0).sum()}"
        f" and undecided at {undecided} of {len(rows)} values of {field}{marked}. Changes of sign:"
        f" {say_crossings(table, field, of)}."
    )


def answer(study: ChaosStudy, tables: dict[str, pd.DataFrame]) -> list[str]:
    """Summarise a study of chaos in sentences."""
    said = [_first(study)]
    if np.isfinite(study.orbit.value[0]):
        said.append(_exponents(study.orbit, ORBIT))
    said += [_exponents(study.drift, DRIFT), _maps(study.maps)]
    if study.law is not None:
        ratio = study.law.table["ratio"]
        half = 0.5 * (study.law.high - study.law.low)
        said.append(
            "The distance of two paths on the same noise after an impact grows as their distance"
            f" before it to the power {study.law.exponent:.4f} ± {half:.4f}; its mean square is"
            f" {ratio.min():.3f} to {ratio.max():.3f} times that of the square-root law. So the"
            " noisy system has no infinitesimal exponent."
        )
    if study.finite_size is not None:
        ends = [
            f"{row['exponent']:.3g} ± {0.5 * (row['high'] - row['low']):.2g} at {row['delta']:.0e}"
            for _, row in study.finite_size.iloc[[0, -1]].iterrows()
        ]
        said.append(f"The finite-size exponent is {' and '.join(ends)}.")
    if study.spectra:
        rows = tables["spectra_summary"]
        spectra = [
            f"{row['side']} {row['velocity']}: {row['lines']} bands ({row['narrow']} as narrow as a"
            f" single frequency) with {row['line_share']:.1%} of the power"
            for row in rows[rows["kind"] == VELOCITY_IN_TIME].to_dict("records")
        ]
        said.append(
            f"Spectra of the velocities, bands above the continuous floor: {'; '.join(spectra)}."
        )
    if study.sweep is not None:
        for of, who in ((ORBIT, "the orbit"), (DRIFT, "the noisy path")):
            said.append(_sweep(study.sweep, study.field, of, who))
    by_reason: dict[str, list[str]] = {}
    for what, reason in study.missing.items():
        by_reason.setdefault(reason, []).append(what)
    said += [f"Left out: {join_words(names)} ({reason})." for reason, names in by_reason.items()]
    return said + explain_missing(study.scene, list(study.maps["closure"]))
