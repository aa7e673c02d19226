"""The words and symbols of the pages, each explained once; a page shows those that it uses."""

from collections.abc import Callable

from rattle.compare.report import Glossary
from rattle.compare.report.texts import read_texts
from rattle.scene.errors import InputError
from rattle.scene.gears import Gears
from rattle.scene.units import Units

TITLE = "Symbols and words of this page"

TERMS: dict[str, str] = read_texts("report")
"""Meaning of each term, in plain words, in the order in which a page lists them."""

CLOSURE_TERMS = ("closure", "`published`", "`corrected`", "`saltation`", "`branching`", "simulation")
SCHEME_TERMS = ("scheme", "`euler-maruyama`", "`euler-maruyama-located`", "`exact-flight`", "exact flight", "dt")
SECTION_TERMS = ("τ", "x1, x2", "y1, y2", "E, sd", "impact", "itinerary")
EXPONENT_TERMS = ("Lyapunov exponent", "drift's linearisation", "finite-size exponent")
CHAOS_TERMS = ("orbit", "mean map", *EXPONENT_TERMS, "square-root law", "band", "sticking")
VERDICT_TERMS = ("accurate", "inaccurate", "undecided", "range of validity")


IN_UNITS: dict[str, Callable[[Units], str]] = {
    "α": lambda u: f"{u.length:.4g} mm",
    "τ": lambda u: f"{u.time:.4g} ms",
    "Δτ": lambda u: f"{u.time:.4g} ms",
    "dt": lambda u: f"{u.time:.4g} ms",
    "x1, x2": lambda u: f"{u.length:.4g} mm",
    "y1, y2": lambda u: f"{u.speed:.4g} mm/s",
    "Lyapunov exponent": lambda u: f"{1e3 / u.time:.4g} per second",
}
"""What 1 is in physical units, of the quantities that have a dimension."""


def glossary(*names: str, gears: Gears | None = None) -> Glossary:
    """The glossary of a page.

    `*names`: Terms that the page uses, keys of `TERMS`; they are listed in the order of `TERMS`. `gears`: Those
    of the page's scene: the glossary then says what 1 is in their units.

    Examples
    --------
    >>> [term for term, _ in glossary("τ", "σ").terms]
    ['σ', 'τ']
    >>> from rattle.scene import DAT21
    >>> print(glossary("Δτ", gears=DAT21).terms[0][1])
    time of flight between two impacts; 1 is 3.333 ms for these gears
    """
    if unknown := set(names) - TERMS.keys():
        raise InputError("names", unknown.pop(), "is not explained; add it to TERMS")
    terms = {name: meaning for name, meaning in TERMS.items() if name in names}
    if gears is not None:
        ones = {name: of(gears.units) for name, of in IN_UNITS.items() if name in terms}
        terms |= {name: f"{terms[name]}; 1 is {one} for these gears" for name, one in ones.items()}
    return Glossary(TITLE, tuple(terms.items()))
