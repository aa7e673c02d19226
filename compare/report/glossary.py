"""The words and symbols of the pages, each explained once; a page shows those that it uses."""

from collections.abc import Callable

from rattle.compare.report import Glossary
from rattle.scene.errors import InputError
from rattle.scene.gears import Gears
from rattle.scene.units import Units

TITLE = "Symbols and words of this page"

TERMS = {
    "closure": "a cheap rule that predicts means and spreads of the motion without simulating paths",
    "`published`": "the closure as the paper prints it",
    "`corrected`": "the same method with its algebra corrected; it still ignores that impact times vary",
    "`saltation`": "follows small deviations from the noise-free orbit to each path's own impact; for weak noise, as "
    "long as nearly all paths strike the same flanks in the same order",
    "`branching`": "follows a mixture of Gaussian densities and splits it where paths separate; for stronger "
    "noise; slower",
    "simulation": "many random paths of the same gears (Monte Carlo), with which every closure is compared",
    "exact flight": "a scheme of the simulation that solves the motion between impacts exactly, without an error from "
    "its time step",
    "scheme": "how the simulation advances a path by a time step",
    "`euler-maruyama`": "the plain scheme: steps of constant acceleration; a path beyond a flank at the end of a step "
    "is thrown back there",
    "`euler-maruyama-located`": "the same with each impact at its own instant within the step",
    "`exact-flight`": "the motion between impacts is solved exactly, without an error from the time step",
    "dt": "time step of the simulation, in units of 1/ω",
    "admissible step": "a step that is stable and sees every gap; a longer one is refused with the longest allowed",
    "default step": "the step that a scheme takes if none is given; if it is too long, it is shortened",
    "diagnostic": "a warning of a run: what may be wrong with its numbers",
    "unbiased": "every section mean and sd is within the tolerance, with its whole interval",
    "biased": "a section mean or sd is outside the tolerance, with its whole interval",
    "unstable": "the numbers grow without bound, or paths are abandoned",
    "no limit": "nothing to compare with: at restitution 0 noise makes infinitely many impacts in a finite time",
    "standard error": "sd of an estimate, because the number of paths is finite",
    "σ": "noise intensity: strength of the random part of the driving motion; 0 is none",
    "α": "amplitude of the driving motion, in units of the backlash",
    "ε": "restitution: speed after an impact over speed before it",
    "τ": "time, in units of 1/ω; the driving motion has period 2π",
    "Δτ": "time of flight between two impacts",
    "x1, x2": "position within the backlash: between driver and wheel 1 (mesh 1), and between wheels 1 and 2 (mesh 2)",
    "y1, y2": "the relative velocities that belong to x1 and x2, just before an impact, in units of ν₁ω: backlash 1 "
    "times the angular frequency of the driving motion",
    "E, sd": "mean and standard deviation over all paths",
    "ρ1, ρ2": "correlation of position and velocity in stage 1 and 2; lies between −1 and 1 for every distribution",
    "stage": "stage 1 is driver and wheel 1, stage 2 is wheel 1 and wheel 2",
    "impact": "impact k is each path's own k-th, at whatever time it happens; moments there are those of the Poincaré "
    "section at the impacts",
    "itinerary": "the order in which a path strikes its meshes and sides",
    "agreement": "share of the paths that still follow the closure's itinerary",
    "realizable": "some distribution has these moments; if not (a negative variance, |ρ| > 1), the prediction is "
    "impossible",
    "accurate": "the error, with its whole interval, is within the tolerance",
    "inaccurate": "shown wrong: the error, with its whole interval, exceeds the tolerance",
    "undecided": "the interval contains the tolerance; more paths or a smaller step will decide",
    "range of validity": "impacts (or values of a parameter) up to which everything a closure predicts is accurate",
    "reproduced": "the stated test has the result that the paper claims",
    "not reproduced": "the stated test has another result than the paper claims",
    "holds only for": "the stated test has the claimed result in the cases that are named, and not in the others",
    "Lyapunov exponent": "rate at which neighbouring motions separate (positive: chaos) or converge (negative)",
    "orbit": "the motion without noise",
    "mean map": "a closure applied again and again: it maps the means at one impact to those at the next",
    "drift's linearisation": "how a small deviation grows along a noisy path if the noise itself is held fixed",
    "finite-size exponent": "the same rate for two paths that are a given distance apart",
    "square-root law": "the distance of two close paths after an impact is proportional to the square root of "
    "that before it",
    "band": "a peak of a power spectrum above its continuous part",
    "sticking": "a mesh stays closed because the flanks are pressed together",
}
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
