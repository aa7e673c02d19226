"""The answer of a study of chaos in a few sentences."""

import numpy as np
import pandas as pd

from rattle.compare.chaos.exponents import DRIFT, ORBIT, Exponents
from rattle.compare.chaos.measure import ChaosStudy
from rattle.compare.chaos.record import STICKS_AT_TIMES, STICKS_FOR_GOOD, STICKS_OFTEN
from rattle.compare.chaos.spectrum import TIME, spectra_tables
from rattle.compare.chaos.sweep import crossings, signs
from rattle.compare.chaos.two_paths import SqrtLaw
from rattle.compare.validation.answer import explain_missing
from rattle.compare.validation.validity_range import join_words
from rattle.scene.gears import Gears

ROUNDING = 1e-12  # a smaller error of the exponents' sum is rounding


def _exponents(e: Exponents, name: str) -> str:
    if not np.isfinite(e.value[0]):
        return f"The {name} has no exponents: the path {e.regime.reason}."
    shown = ", ".join(f"{v:.4f} ± {h:.4f}" for v, h in zip(e.value, e.half, strict=True))
    return (
        f"The {name} has the exponents {shown} per unit of dimensionless time ({e.impacts:,} impacts, "
        f"{e.rate:.3f} a unit; their sum {_sum(e.sum_error)}); it {e.regime.reason}."
    )


def _sum(error: float) -> str:
    if abs(error) < ROUNDING:
        return "is the exact one, to rounding"
    return f"differs from the exact one by {abs(error):.0e}"


def _first(orbit: Exponents, field: str, sweep: pd.DataFrame | None, gears: Gears | None) -> str:
    """Whether the motion without noise is chaotic, here and over the field."""
    value, low, high = orbit.largest
    found = f"largest Lyapunov exponent {value:.3g} ± {0.5 * (high - low):.1g}"
    if gears is not None:
        found += f" per unit of τ, {gears.omega * value:.3g} per second"
    if not np.isfinite(value):
        said = f"Without noise this gear pair has no Lyapunov exponents: it {orbit.regime.reason}"
    elif low > 0.0:
        said = f"Without noise this gear pair rattles chaotically ({found})"
    elif high < 0.0:
        said = f"Without noise this gear pair rattles regularly, not chaotically ({found})"
    else:
        said = f"Whether this gear pair rattles chaotically without noise is undecided ({found})"
    if sweep is None:
        return f"{said}."
    rows = sweep[sweep["of"] == ORBIT]
    return (
        f"{said}; over {field} from {rows[field].min():.3g} to {rows[field].max():.3g} it is chaotic at "
        f"{(signs(rows) > 0).sum()} of {len(rows)} values."
    )


def _maps(maps: pd.DataFrame) -> str:
    words = []
    for _, row in maps.iterrows():
        if row["closure"] == "published":
            broken, ended = np.isfinite(row["not_realizable"]), row["ends"] < row["followed"]
            clauses = [f"is not realizable from impact {row['not_realizable']:g} on"] if broken else []
            clauses += [f"ends at impact {row['ends']:g}"] if ended else []
            words.append(f"`published` {join_words([*clauses, 'has no exponents'])}")
        elif np.isnan(row["largest"]):
            words.append(f"`{row['closure']}` has none, like the orbit")
        elif np.isfinite(row["too_wide"]):
            words.append(
                f"`{row['closure']}` has the orbit's, and from impact {row['too_wide']:g} on its sd of y1 is larger "
                "than that of the whole orbit"
            )
        else:
            words.append(f"`{row['closure']}` has the orbit's")
    lost = "A closure whose sd is that large no longer locates the motion."
    return f"Exponents of the mean maps: {'; '.join(words)}.{f' {lost}' if maps['too_wide'].notna().any() else ''}"


def _sizes(table: pd.DataFrame) -> str:
    first, last = table.iloc[0], table.iloc[-1]
    return (
        f"The finite-size exponent is {first['exponent']:.3g} ± {0.5 * (first['high'] - first['low']):.2g} at "
        f"{first['delta']:.0e} and {last['exponent']:.3g} ± {0.5 * (last['high'] - last['low']):.2g} at "
        f"{last['delta']:.0e}."
    )


def _law(law: SqrtLaw) -> str:
    half = 0.5 * (law.high - law.low)
    return (
        "The distance of two paths on the same noise after an impact grows as their distance before it to the power "
        f"{law.exponent:.4f} ± {half:.4f}; its mean square is {law.table['ratio'].min():.3f} to "
        f"{law.table['ratio'].max():.3f} times that of the square-root law. So the noisy system has no infinitesimal "
        "exponent."
    )


def _spectra(summary: pd.DataFrame) -> str:
    rows = summary[summary["kind"] == TIME]
    parts = [
        f"{r['side']} {r['velocity']}: {r['lines']} bands ({r['narrow']} as narrow as a single frequency) with "
        f"{r['line_share']:.1%} of the power"
        for _, r in rows.iterrows()
    ]
    return f"Spectra of the velocities, bands above the continuous floor: {'; '.join(parts)}."


def _sweep(table: pd.DataFrame, field: str) -> list[str]:
    said = []
    for of in (ORBIT, DRIFT):
        rows = table[table["of"] == of]
        changes = crossings(table, field, of)
        found = signs(rows)
        numbers = (
            f"positive at {(found > 0).sum()}, negative at {(found < 0).sum()} and undecided at "
            f"{((found == 0) & rows['low'].notna()).sum()} of {len(rows)} values of {field}"
        )
        kinds = {kind: int((rows["regime"] == kind).sum()) for kind in (STICKS_FOR_GOOD, STICKS_OFTEN, STICKS_AT_TIMES)}
        sticking = [f"{kind} at {n}" for kind, n in kinds.items() if n]
        who = "the orbit" if of == ORBIT else "the noisy path"
        marked = f"; {who} {join_words(sticking)}" if sticking else ""
        where = "; ".join(
            f"{'+' if r['to'] > 0 else '-'} between {r['low']:.3g} and {r['high']:.3g}" for _, r in changes.iterrows()
        )
        said.append(f"Largest exponent, {of}: {numbers}{marked}. Changes of sign: {where or 'none'}.")
    return said


def answer(study: ChaosStudy) -> list[str]:
    """Summarise a study of chaos in sentences."""
    gears = study.scene.gears
    said = [_first(study.orbit, study.field, study.sweep, gears)]
    if np.isfinite(study.orbit.value[0]):
        said.append(_exponents(study.orbit, ORBIT))
    said += [_exponents(study.drift, DRIFT), _maps(study.maps)]
    if study.law is not None:
        said.append(_law(study.law))
    if study.finite_size is not None:
        said.append(_sizes(study.finite_size))
    if study.spectra:
        said.append(_spectra(spectra_tables(study.spectra)[2]))
    if study.sweep is not None:
        said += _sweep(study.sweep, study.field)
    by_reason: dict[str, list[str]] = {}
    for what, reason in study.missing.items():
        by_reason.setdefault(reason, []).append(what)
    said += [f"Left out: {join_words(names)} ({reason})." for reason, names in by_reason.items()]
    return said + explain_missing(study.scene, list(study.maps["closure"]))
