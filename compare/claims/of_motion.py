"""The paper's claims on the motion, its chaos and spectra, one function each: the test, the evidence, the verdict."""

from typing import Any

import numpy as np
import pandas as pd

from rattle.compare.chaos.exponents import DRIFT, ORBIT, Exponents
from rattle.compare.chaos.measure import CLAIMED
from rattle.compare.chaos.record import STICKS_AT_TIMES, STICKS_FOR_GOOD, STICKS_OFTEN
from rattle.compare.chaos.section import NOISY, Section
from rattle.compare.chaos.spectrum import TIME, spectra_tables
from rattle.compare.chaos.sweep import crossings
from rattle.compare.claims.evidence import (
    HOLDS_ONLY,
    NOT_REPRODUCED,
    REPRODUCED,
    UNDECIDED,
    Evidence,
    PaperClaim,
    judge_parts,
)
from rattle.compare.validation.verdict import join_words

FUZZY = 0.05  # smallest share of the noisy section's bins that a fuzzy set fills
FINITE = 100  # largest number of bins that a periodic orbit of moderate length fills


def counter_meshes(e: Evidence) -> PaperClaim:
    """Judge section 4: consecutive impacts are at counter meshes."""
    orbit, noisy = e.repeats["orbit"], e.repeats["noisy"]
    none = all(m.value - m.half <= 0.0 for m in (orbit, noisy))
    return PaperClaim(
        "Counter meshes",
        "section 4",
        "considering counter meshes of the gears E[x]ₖ₊₁ = −E[x]ₖ",
        "Share of consecutive impacts at one mesh (whatever happens at the other in between) that are on the same "
        "flank; zero if the claim holds.",
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
    return PaperClaim(
        "A fuzzy Poincaré map (Fig. 2)",
        "section 4, Fig. 2",
        "The structures of Fig. 2 display a fuzzy set of points.",
        f"Bins of (flight time, velocity of stage 1 before the impact) that contain a point. A periodic orbit fills at "
        f"most {FINITE}; a fuzzy set fills more than {FUZZY:.0%} of the number that the noisy system fills.",
        f"{text}. The published map is not realizable from impact {published['not_realizable']:g} and ends at impact "
        f"{published['ends']:g}, so it has no section.",
        HOLDS_ONLY.format("the orbit under the corrected map; the published map ends before it has a section")
        if orbit > max(FINITE, FUZZY * noisy)
        else (UNDECIDED if orbit > FINITE else NOT_REPRODUCED),
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
        where = "; ".join(
            f"{'+' if r['to'] > 0 else '-'} between {r['low']:.3g} and {r['high']:.3g}"
            for _, r in crossings(table, "alpha", of).iterrows()
        )
        shown.append(
            f"{of}: positive at {int(positive[inside].sum())} of {int(inside.sum())} values inside and at "
            f"{int(positive[~inside].sum())} of {int((~inside).sum())} outside, negative at "
            f"{int(negative[inside].sum())} inside and {int(negative[~inside].sum())} outside{_sticking(rows)}; "
            f"changes of sign: {where or 'none'}"
        )
        if positive[inside].all():
            chaotic.append(f"the {of}")
    return PaperClaim(
        "The range of chaos (Fig. 4)",
        "section 4, Fig. 4",
        f"… the maximal exponent of Lyapunov is plus when {CLAIMED[0]} ≤ α ≤ {CLAIMED[1]}. In this range, the chaos "
        "can be happen.",
        "Largest exponent with its 95 % interval at each α of the sweep, of the orbit (and of every mean map whose "
        "moments follow it) and of the drift's linearisation along noisy paths with σ = √α. Reproduced if positive "
        "throughout the range; of α outside the paper says nothing.",
        "; ".join(shown) + ".",
        judge_parts(chaotic, 2),
    )


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
    return PaperClaim(
        "Chaos with one stage and with two",
        "section 5",
        "Comparing the two-stage model with the single stage model …, both models reveal the random chaos on the "
        "dynamics of a rattling system.",
        "Largest exponent of DAT21 and of its first stage alone, with a 95 % interval above zero. The parameters of "
        "the single stage in the paper's reference 7 are others, and not given in the paper: its own results are not "
        "tested here. A noisy system has no "
        "infinitesimal exponent (the distance of two paths after an impact is proportional to the square root of that "
        "before it), so the exponent of the drift's linearisation is used instead.",
        text + ".",
        judge_parts(chaotic, len(found)),
    )


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
    return PaperClaim(
        "Control by a parameter",
        "section 5",
        "… the chaotic stochastic vibration can be controlled by variation of a two-stage rattling system parameter.",
        "Whether the largest exponent has both signs over α, with intervals that exclude zero: of the orbit, and of "
        "the drift's linearisation along noisy paths with σ = √α, for the claim is on the stochastic vibration.",
        "; ".join(shown) + ".",
        judge_parts(both_signs, 2, transition),
    )


def narrow_bands(e: Evidence) -> PaperClaim:
    """Judge Fig. 3: narrow-band spectra."""
    rows = _spectra(e)
    shown = [
        f"{r['side']} {r['velocity']}: {r['narrow']} narrow of {r['lines']} bands, {r['line_share']:.1%} of the power"
        for r in rows
    ]
    narrow = [_of(side) for side in _sides(rows) if all(r["narrow"] for r in rows if r["side"] == side)]
    if e.mean.periodic:
        narrow.append("the ensemble's mean")
    return PaperClaim(
        "Narrow bands (Fig. 3)",
        "section 4, Fig. 3",
        "Figure 3(a,b) show the power spectra of mean velocity … In the Fig. 3 narrow band spectra are exhibited.",
        "Bands of the velocity in time that stand above the local floor (1 % false alarm for the whole spectrum) and "
        "are no wider than a single frequency: of the published map, of the ensemble's mean, of the orbit (which the "
        "means of the corrected map follow) and of single paths, one by one.",
        f"{_say_published_map(e)} {_ensemble_mean(e)} " + _sentence("; ".join(shown)),
        _each(e, narrow, 1 + len(_sides(rows))),
    )


def _each(e: Evidence, found: list[str], sought: int) -> str:
    """Verdict on a claim about the published map's mean velocity, which of the others show it too."""
    ended = _end_of_published_map(e)
    if not found:
        return UNDECIDED if ended is None else NOT_REPRODUCED
    if ended is None and len(found) == sought:
        return REPRODUCED
    map_ = "; the published map ends before it has a spectrum" if ended is not None else ""
    return HOLDS_ONLY.format(f"{join_words(found)}{map_}")


def _end_of_published_map(e: Evidence) -> int | None:
    """The impact at which the published map ends; None if it goes on."""
    row = e.chaos.maps[e.chaos.maps["closure"] == "published"].to_dict("records")[0]
    return int(row["ends"]) if row["ends"] < row["followed"] else None


def _say_published_map(e: Evidence) -> str:
    ended = _end_of_published_map(e)
    if ended is None:
        return "The published map does not end; its spectrum is not measured here."
    return f"The published map ends at impact {ended} and has no spectrum."


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


def _sides(rows: list[dict[str, Any]]) -> list[str]:
    return list(dict.fromkeys(str(r["side"]) for r in rows))


def _of(side: str) -> str:
    return "single noisy paths" if side == NOISY else f"the {side}"


def _sentence(text: str) -> str:
    return text[0].upper() + text[1:] + "."


def continuous(e: Evidence) -> PaperClaim:
    """Judge section 5: continuous spectra."""
    rows = _spectra(e)
    shown = [f"{r['side']} {r['velocity']}: {r['floor_share']:.1%}" for r in rows]
    mostly = [_of(side) for side in _sides(rows) if all(r["floor_share"] > 0.5 for r in rows if r["side"] == side)]
    if not e.mean.periodic:
        mostly.append("the ensemble's mean")
    return PaperClaim(
        "A continuous spectrum",
        "section 5",
        "… the power spectra of mean velocity display the behavior of a continuous spectrum.",
        "Share of the power that is in no band above the floor, more than half in every spectrum: of the published "
        "map, of the ensemble's mean, of the orbit (which the means of the corrected map follow) and of single paths, "
        "one by one.",
        f"{_say_published_map(e)} {_ensemble_mean(e)} " + _sentence("; ".join(shown)),
        _each(e, mostly, 1 + len(_sides(rows))),
    )


def _spectra(e: Evidence) -> list[dict[str, Any]]:
    summary = spectra_tables(e.chaos.spectra)[2]
    return [dict(row) for _, row in summary[summary["kind"] == TIME].iterrows()]
