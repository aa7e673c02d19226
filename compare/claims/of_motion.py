"""The paper's claims on the motion and its chaos, one function each: the test, the evidence, the verdict."""

from typing import Any

import numpy as np

from rattle.compare.chaos.exponents import DRIFT, ORBIT, Exponents
from rattle.compare.chaos.measure import CLAIMED
from rattle.compare.chaos.section import Section
from rattle.compare.chaos.spectrum import TIME, spectra_tables
from rattle.compare.chaos.sweep import crossings
from rattle.compare.claims.claim import HOLDS_ONLY, NOT_REPRODUCED, REPRODUCED, UNDECIDED, Claim
from rattle.compare.claims.evidence import Evidence

__all__ = ["both_models", "chaotic_range", "continuous", "controlled", "counter_meshes", "fuzzy", "narrow_bands"]

FUZZY = 0.05  # smallest share of the noisy section's bins that a fuzzy set fills
FINITE = 100  # largest number of bins that a periodic orbit of moderate length fills


def counter_meshes(e: Evidence) -> Claim:
    """Judge section 4: consecutive impacts are at counter meshes.

    Parameters
    ----------
    e : Evidence
        What the claims are judged by.

    Returns
    -------
    Claim
    """
    orbit, noisy = e.repeats["orbit"], e.repeats["noisy"]
    none = all(m.value - m.half <= 0.0 for m in (orbit, noisy))
    return Claim(
        "Counter meshes",
        "section 4", "Counter meshes: the next impact is at the opposite flank, E[x] turns into −E[x].",
        "Share of consecutive impacts at one mesh that are on the same flank; zero if the claim holds.",
        f"Orbit {orbit.value:.1%} ± {orbit.half:.1%}, noisy system {noisy.value:.1%} ± {noisy.half:.1%}.",
        REPRODUCED if none else NOT_REPRODUCED,
    )  # fmt: skip


def fuzzy(e: Evidence) -> Claim:
    """Judge Fig. 2: the mean Poincaré map is a fuzzy set of points.

    Parameters
    ----------
    e : Evidence
        What the claims are judged by.

    Returns
    -------
    Claim
    """
    sections = e.chaos.sections
    filled = {side: int((s.counts[0] > 0).sum()) for side, s in sections.items()}
    noisy = filled["noisy system"]
    published = e.chaos.maps.set_index("closure").loc["published"]
    text = ", ".join(f"{side} {n:,} of {_bins(sections[side]):,} bins" for side, n in filled.items())
    orbit = filled.get("orbit", 0)
    return Claim(
        "A fuzzy Poincaré map (Fig. 2)",
        "section 4, Fig. 2", "The mean Poincaré map displays a fuzzy set of points.",
        f"Bins of (flight time, velocity of stage 1 before the impact) that contain a point. A periodic orbit fills at "
        f"most {FINITE}; a fuzzy set fills more than {FUZZY:.0%} of the number that the noisy system fills.",
        f"{text}. The published map is not realizable from impact {published['not_realizable']:g} and ends at impact "
        f"{published['ends']:g}, so it has no section.",
        HOLDS_ONLY.format("the orbit under the corrected map; the published map ends before it has a section")
        if orbit > max(FINITE, FUZZY * noisy) else (UNDECIDED if orbit > FINITE else NOT_REPRODUCED),
    )  # fmt: skip


def _bins(s: Section) -> int:
    return int(s.counts[0].size)


def narrow_bands(e: Evidence) -> Claim:
    """Judge Fig. 3: narrow-band spectra.

    Parameters
    ----------
    e : Evidence
        What the claims are judged by.

    Returns
    -------
    Claim
    """
    rows = _spectra(e)
    shown = [
        f"{r['side']} {r['velocity']}: {r['narrow']} narrow of {r['lines']} bands, {r['line_share']:.1%} of the power"
        for r in rows
    ]
    sides = {r["side"] for r in rows if r["narrow"] > 0}
    return Claim(
        "Narrow bands (Fig. 3)",
        "section 4, Fig. 3", "The power spectra of the mean velocity exhibit narrow bands.",
        "Bands of the velocity in time that stand above the local floor (1 % false alarm for the whole spectrum) and "
        "are no wider than a single frequency.", "; ".join(shown) + ".",
        REPRODUCED if len(sides) == len({r["side"] for r in rows})
        else (HOLDS_ONLY.format("the " + " and the ".join(sorted(sides))) if sides else NOT_REPRODUCED),
    )  # fmt: skip


def continuous(e: Evidence) -> Claim:
    """Judge section 5: continuous spectra.

    Parameters
    ----------
    e : Evidence
        What the claims are judged by.

    Returns
    -------
    Claim
    """
    rows = _spectra(e)
    shown = [f"{r['side']} {r['velocity']}: {r['floor_share']:.1%}" for r in rows]
    least = min(r["floor_share"] for r in rows)
    return Claim(
        "A continuous spectrum",
        "section 5", "The power spectra of the mean velocity display the behaviour of a continuous spectrum.",
        "Share of the power that is in no band above the floor; more than half on both sides.", "; ".join(shown) + ".",
        REPRODUCED if least > 0.5 else HOLDS_ONLY.format(
            f"{sum(r['floor_share'] > 0.5 for r in rows)} of {len(rows)} spectra; the others are mostly bands"
        ),
    )  # fmt: skip


def _spectra(e: Evidence) -> list[dict[str, Any]]:
    summary = spectra_tables(e.chaos.spectra)[2]
    return [dict(row) for _, row in summary[summary["kind"] == TIME].iterrows()]


def chaotic_range(e: Evidence) -> Claim:
    """Judge Fig. 4: the largest exponent is positive for 0.2 <= alpha <= 1.7, and not outside.

    Parameters
    ----------
    e : Evidence
        What the claims are judged by.

    Returns
    -------
    Claim
    """
    table = e.chaos.sweep
    assert table is not None
    shown: list[str] = []
    chaotic: list[str] = []  # systems with positive exponents throughout the range
    bounded = 0
    for of in (ORBIT, DRIFT):
        rows = table[table["of"] == of]
        inside = rows["alpha"].between(*CLAIMED)
        positive, negative = rows["low"] > 0.0, rows["high"] < 0.0
        where = "; ".join(
            f"{'+' if r['to'] > 0 else '-'} between {r['low']:.3g} and {r['high']:.3g}"
            for _, r in crossings(table, "alpha", of).iterrows()
        )
        sticking = int((rows["regime"] == "sticks").sum())
        shown.append(
            f"{of}: positive at {int(positive[inside].sum())} of {int(inside.sum())} values inside and at "
            f"{int(positive[~inside].sum())} of {int((~inside).sum())} outside, negative at "
            f"{int(negative[inside].sum())} inside and {int(negative[~inside].sum())} outside, sticking for good at "
            f"{sticking}; changes of sign: {where or 'none'}"
        )
        if positive[inside].all():
            chaotic.append(of if not positive[~inside].any() else f"{of}, which is positive outside too")
        bounded += bool(positive[inside].all() and not positive[~inside].any())
    if bounded == 2:
        verdict = REPRODUCED
    else:
        verdict = HOLDS_ONLY.format("the " + "; the ".join(chaotic)) if chaotic else NOT_REPRODUCED
    return Claim(
        "The range of chaos (Fig. 4)",
        "section 4, Fig. 4", f"The maximal Lyapunov exponent is positive for {CLAIMED[0]} ≤ α ≤ {CLAIMED[1]}.",
        "Largest exponent with its 95 % interval at each α of the sweep, of the orbit (and of every mean map whose "
        "moments follow it) and of the drift's linearisation along noisy paths with σ = √α. Reproduced if positive "
        "throughout the range and nowhere outside.",
        "; ".join(shown) + ".", verdict,
    )  # fmt: skip


def both_models(e: Evidence) -> Claim:
    """Judge section 5: the single-stage model and the two-stage model both show random chaos.

    Parameters
    ----------
    e : Evidence
        What the claims are judged by.

    Returns
    -------
    Claim
    """
    found: dict[str, Exponents] = {
        "single stage, orbit": e.single["orbit"], "single stage, along noisy paths": e.single["noisy"],
        "two stages, orbit": e.chaos.orbit, "two stages, along noisy paths": e.chaos.drift,
    }  # fmt: skip
    signs = {name: _sign(x) for name, x in found.items()}
    text = "; ".join(f"{name}: {_exponent(x)}" for name, x in found.items())
    chaotic = [name for name, s in signs.items() if s > 0]
    if len(chaotic) == len(found):
        verdict = REPRODUCED
    else:
        verdict = HOLDS_ONLY.format("; ".join(chaotic)) if chaotic else NOT_REPRODUCED
    return Claim(
        "Chaos with one stage and with two",
        "section 5", "Both the single-stage and the two-stage model reveal random chaos.",
        "Largest exponent of DAT21 and of its single stage, with a 95 % interval above zero. A noisy system has no "
        "infinitesimal exponent (the distance of two paths after an impact is proportional to the square root of that "
        "before it), so the exponent of the drift's linearisation is used instead.", text + ".", verdict,
    )  # fmt: skip


def _sign(x: Exponents) -> int:
    value, low, high = x.largest
    return 0 if not np.isfinite(value) else (1 if low > 0.0 else (-1 if high < 0.0 else 0))


def _exponent(x: Exponents) -> str:
    value, low, high = x.largest
    return f"{value:.4f} ({low:.4f} to {high:.4f})" if np.isfinite(value) else x.regime.reason


def controlled(e: Evidence) -> Claim:
    """Judge section 5: chaos can be controlled by a parameter.

    Parameters
    ----------
    e : Evidence
        What the claims are judged by.

    Returns
    -------
    Claim
    """
    table = e.chaos.sweep
    assert table is not None
    rows = table[table["of"] == ORBIT]
    positive, negative = int((rows["low"] > 0.0).sum()), int((rows["high"] < 0.0).sum())
    sticking = int((rows["regime"] == "sticks").sum())
    return Claim(
        "Control by a parameter",
        "section 5", "The chaotic vibration can be controlled by varying a parameter of the system.",
        "Whether the largest exponent of the orbit has both signs over α, with intervals that exclude zero.",
        f"Positive at {positive}, negative at {negative}, sticking for good at {sticking} of {len(rows)} values of α.",
        REPRODUCED if positive and negative
        else (HOLDS_ONLY.format("the transition from sticking to chaos") if positive and sticking else UNDECIDED),
    )  # fmt: skip
