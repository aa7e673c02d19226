"""The paper's claims on the motion, its chaos and spectra, one function each: the test, the evidence, the verdict."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd

from rattle.compare.chaos.exponents import DRIFT, ORBIT, Exponents
from rattle.compare.chaos.measure import CLAIMED
from rattle.compare.chaos.record import STICKS_AT_TIMES, STICKS_FOR_GOOD, STICKS_OFTEN
from rattle.compare.chaos.section import NOISY, Section
from rattle.compare.chaos.spectrum import TIME, spectra_tables
from rattle.compare.chaos.sweep import say_crossings
from rattle.compare.checks.claims.evidence import (
    HOLDS_ONLY,
    NOT_REPRODUCED,
    REPRODUCED,
    UNDECIDED,
    Evidence,
    PaperClaim,
    claim,
    judge_parts,
)
from rattle.compare.validation.verdict import join_words

FUZZY = 0.05  # smallest share of the noisy section's bins that a fuzzy set fills
FINITE = 100  # largest number of bins that a periodic orbit of moderate length fills


def counter_meshes(e: Evidence) -> PaperClaim:
    """Judge section 4: consecutive impacts are at counter meshes."""
    orbit, noisy = e.repeats["orbit"], e.repeats["noisy"]
    none = all(m.value - m.half <= 0.0 for m in (orbit, noisy))
    return claim(
        "counter_meshes",
        f"Orbit {orbit.value:.1%} ± {orbit.half:.1%}, noisy system {noisy.value:.1%} ± {noisy.half:.1%}.",
        REPRODUCED if none else NOT_REPRODUCED,
    )


def fuzzy(e: Evidence) -> PaperClaim:
    """Judge Fig. 2: the mean Poincaré map is a fuzzy set of points."""
    sections = e.chaos.sections
    filled = {side: int((s.counts[0] > 0).sum()) for side, s in sections.items()}
    noisy = filled["noisy system"]
    published = e.chaos.maps.set_index("closure").loc["published"]
    text = ", ".join(f"{side} {n:,} of {_bins(sections[side]):,} bins" for side, n in filled.items())
    orbit = filled.get("orbit", 0)
    return claim(
        "fuzzy",
        f"{text}. The published map is not realizable from impact {published['not_realizable']:g} and ends at impact "
        f"{published['ends']:g}, so it has no section.",
        HOLDS_ONLY.format("the orbit under the corrected map; the published map ends before it has a section")
        if orbit > max(FINITE, FUZZY * noisy)
        else (UNDECIDED if orbit > FINITE else NOT_REPRODUCED),
        finite=FINITE,
        fuzzy=FUZZY,
    )


def _bins(s: Section) -> int:
    return int(s.counts[0].size)


def chaotic_range(e: Evidence) -> PaperClaim:
    """Judge Fig. 4: the largest exponent is positive for 0.2 <= alpha <= 1.7."""
    table = e.chaos.sweep
    assert table is not None
    shown: list[str] = []
    chaotic: list[str] = []  # systems with positive exponents throughout the range
    for of in (ORBIT, DRIFT):
        rows = table[table["of"] == of]
        inside = rows["alpha"].between(*CLAIMED)
        positive, negative = rows["low"] > 0.0, rows["high"] < 0.0
        shown.append(
            f"{of}: positive at {int(positive[inside].sum())} of {int(inside.sum())} values inside and at "
            f"{int(positive[~inside].sum())} of {int((~inside).sum())} outside, negative at "
            f"{int(negative[inside].sum())} inside and {int(negative[~inside].sum())} outside{_sticking(rows)}; "
            f"changes of sign: {say_crossings(table, 'alpha', of)}"
        )
        if positive[inside].all():
            chaotic.append(f"the {of}")
    return claim("chaotic_range", "; ".join(shown) + ".", judge_parts(chaotic, 2))


def _sticking(rows: pd.DataFrame) -> str:
    """Where the orbit sticks, and the sign of the exponent there."""
    positive, said = rows["low"] > 0.0, ""
    at_times = rows["regime"] == STICKS_AT_TIMES
    if at_times.any():
        signs = "all of them positive" if positive[at_times].all() else f"{int(positive[at_times].sum())} positive"
        said = f"; sticking at times, with the exponent of the motion between, at {int(at_times.sum())} values, {signs}"
    without = {kind: int((rows["regime"] == kind).sum()) for kind in (STICKS_OFTEN, STICKS_FOR_GOOD)}
    return said + "".join(f"; without an exponent, as it {kind}, at {n}" for kind, n in without.items() if n)


def both_models(e: Evidence) -> PaperClaim:
    """Judge section 5: the single-stage model and the two-stage model both show random chaos."""
    found: dict[str, Exponents] = {
        "single stage, orbit": e.single["orbit"],
        "single stage, along noisy paths": e.single["noisy"],
        "two stages, orbit": e.chaos.orbit,
        "two stages, along noisy paths": e.chaos.drift,
    }
    signs = {name: _sign(x) for name, x in found.items()}
    text = "; ".join(f"{name}: {_exponent(x)}" for name, x in found.items())
    chaotic = [name for name, s in signs.items() if s > 0]
    return claim("both_models", text + ".", judge_parts(chaotic, len(found)))


def _sign(x: Exponents) -> int:
    value, low, high = x.largest
    return 0 if not np.isfinite(value) else (1 if low > 0.0 else (-1 if high < 0.0 else 0))


def _exponent(x: Exponents) -> str:
    value, low, high = x.largest
    return f"{value:.4f} ({low:.4f} to {high:.4f})" if np.isfinite(value) else x.regime.reason


def control(e: Evidence) -> PaperClaim:
    """Judge section 5: chaos can be controlled by a parameter."""
    table = e.chaos.sweep
    assert table is not None
    shown: list[str] = []
    both_signs: list[str] = []
    sticks = False
    for of in (ORBIT, DRIFT):
        rows = table[table["of"] == of]
        positive, negative = int((rows["low"] > 0.0).sum()), int((rows["high"] < 0.0).sum())
        sticking = int(rows["regime"].isin((STICKS_OFTEN, STICKS_FOR_GOOD)).sum())
        without = f", without an exponent for sticking often or for good at {sticking}" if sticking else ""
        shown.append(f"{of}: positive at {positive}, negative at {negative}{without} of {len(rows)} values of α")
        if positive and negative:
            both_signs.append(f"the {of}")
        sticks = sticks or bool(positive and sticking)
    transition = HOLDS_ONLY.format("the transition from sticking to chaos") if sticks else UNDECIDED
    return claim("control", "; ".join(shown) + ".", judge_parts(both_signs, 2, transition))


def narrow_bands(e: Evidence) -> PaperClaim:
    """Judge Fig. 3: narrow-band spectra."""
    form = "{side} {velocity}: {narrow} narrow of {lines} bands, {line_share:.1%} of the power"
    return _judge_spectra(e, "narrow_bands", form, lambda rows: rows["narrow"] > 0, e.mean.periodic)


def continuous(e: Evidence) -> PaperClaim:
    """Judge section 5: continuous spectra."""
    form = "{side} {velocity}: {floor_share:.1%}"
    return _judge_spectra(e, "continuous", form, lambda rows: rows["floor_share"] > 0.5, not e.mean.periodic)


def _judge_spectra(
    e: Evidence, judged: str, form: str, has: Callable[[pd.DataFrame], Any], mean_has: bool
) -> PaperClaim:
    """Judge a claim on the mean velocity of the published map: which of orbit, single paths and their mean show it."""
    summary = spectra_tables(e.chaos.spectra)[2]
    rows = summary[summary["kind"] == TIME]
    shown = "; ".join(form.format_map(row) for row in rows.to_dict("records"))
    shows = has(rows).groupby(rows["side"], sort=False).all()
    found = ["single noisy paths" if side == NOISY else f"the {side}" for side in shows.index[shows]]
    found += ["the ensemble's mean"] if mean_has else []
    (published,) = e.chaos.maps[e.chaos.maps["closure"] == "published"].to_dict("records")
    ended = published["ends"] < published["followed"]
    said = "The published map does not end; its spectrum is not measured here."
    if ended:
        said = f"The published map ends at impact {published['ends']:g} and has no spectrum."
    if not found:
        verdict = NOT_REPRODUCED if ended else UNDECIDED
    elif not ended and len(found) > len(shows):
        verdict = REPRODUCED
    else:
        clause = "; the published map ends before it has a spectrum" if ended else ""
        verdict = HOLDS_ONLY.format(f"{join_words(found)}{clause}")
    return claim(judged, f"{said} {_ensemble_mean(e)} {shown[0].upper()}{shown[1:]}.", verdict)


def _ensemble_mean(e: Evidence) -> str:
    share = join_words(
        [f"{share:.1%} of the variance of y{stage}" for stage, share in enumerate(e.mean.share, start=1)]
    )
    found = (
        "repeats itself with the excitation, so that its spectrum is lines at multiples of that frequency and nothing "
        "between"
        if e.mean.periodic
        else "does not repeat itself with the excitation"
    )
    return (
        f"The mean over {e.mean.paths:,} paths {found} (largest change from period to period {e.mean.largest:.1f} "
        f"standard errors, {e.mean.allowed:.1f} allowed); it is {share}."
    )
