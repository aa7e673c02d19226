"""The paper's claims on the spectra of the mean velocity, one function each: the test, the evidence, the verdict."""

from typing import Any

from rattle.compare.chaos.section import NOISY
from rattle.compare.chaos.spectrum import TIME, spectra_tables
from rattle.compare.claims.claim import HOLDS_ONLY, NOT_REPRODUCED, REPRODUCED, UNDECIDED, PaperClaim
from rattle.compare.claims.evidence import Evidence
from rattle.compare.validation.validity_range import join_words


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
