"""The words and symbols of the pages, each explained once; a page shows those that it uses."""

from rattle.compare.report.content import Glossary
from rattle.scene.errors import InputError

__all__ = ["CLOSURE_TERMS", "SECTION_TERMS", "TERMS", "TITLE", "VERDICT_TERMS", "glossary"]

TITLE = "Symbols and words of this page"

TERMS = {
    "closure": "a cheap rule that predicts means and spreads of the motion without simulating paths",
    "published": "the closure as the paper prints it",
    "corrected": "the same method with its algebra corrected; impact times still do not vary in it",
    "saltation": "follows small deviations from the noise-free orbit to each path's own impact; for weak noise, as "
    "long as nearly all paths strike the same flanks in the same order",
    "branching": "follows a mixture of Gaussian densities and splits it where paths part; for stronger noise; slower",
    "simulation": "many random paths of the same gears, counted (Monte Carlo); the measure of every closure",
    "exact flight": "a scheme of the simulation that solves the motion between impacts exactly, without an error from "
    "its time step",
    "σ": "noise intensity: strength of the random part of the driving motion; 0 is none",
    "α": "amplitude of the driving motion, in units of the backlash",
    "ε": "restitution: speed after an impact over speed before it",
    "τ": "time, in units of 1/ω; the driving motion has period 2π",
    "Δτ": "time of flight between two impacts",
    "x1, x2": "position within the backlash: between driver and wheel 1 (mesh 1), and between wheels 1 and 2 (mesh 2)",
    "y1, y2": "the relative velocities that belong to x1 and x2, just before an impact",
    "E, sd": "mean and standard deviation over all paths",
    "ρ1, ρ2": "correlation of position and velocity in stage 1 and 2; lies between −1 and 1 for every distribution",
    "stage": "stage 1 is driver and wheel 1, stage 2 is wheel 1 and wheel 2",
    "impact k": "each path's own k-th impact, at whatever time it happens; moments there are those of the Poincaré "
    "section at the impacts",
    "itinerary": "the order in which a path strikes its meshes and sides",
    "agreement": "share of the paths that still follow the closure's itinerary",
    "realizable": "some distribution has these moments; if not (a negative variance, |ρ| > 1), the prediction is "
    "impossible",
    "accurate": "the error, with its whole interval, is within the tolerance",
    "inaccurate": "shown wrong: the error, with its whole interval, exceeds the tolerance",
    "undecided": "the interval contains the tolerance; more paths or a smaller step would decide",
    "range of validity": "impacts (or values of a parameter) up to which everything a closure predicts is accurate",
    "Lyapunov exponent": "rate at which neighbouring motions part (positive: chaos) or close up (negative)",
    "orbit": "the motion without noise",
    "mean map": "a closure applied again and again: it maps the means at one impact to those at the next",
    "drift's linearisation": "how a small deviation grows along a noisy path if the noise itself is held fixed",
    "finite-size exponent": "the same rate for two paths that are a given distance apart",
    "square-root law": "after an impact two close paths are as far apart as the root of their distance before it",
    "band": "a peak of a power spectrum above its continuous part",
    "sticking": "a mesh stays closed because the flanks are pressed together",
}
"""Meaning of each term, in plain words, in the order in which a page lists them."""

CLOSURE_TERMS = ("closure", "published", "corrected", "saltation", "branching", "simulation")
SECTION_TERMS = ("τ", "x1, x2", "y1, y2", "E, sd", "impact k", "itinerary")
VERDICT_TERMS = ("accurate", "inaccurate", "undecided", "range of validity")


def glossary(*names: str) -> Glossary:
    """The glossary of a page.

    Parameters
    ----------
    *names : str
        Terms that the page uses, keys of `TERMS`; they are listed in the order of `TERMS`.

    Returns
    -------
    Glossary

    Raises
    ------
    InputError
        For a term that is not explained here.

    Examples
    --------
    >>> [term for term, _ in glossary("τ", "σ").terms]
    ['σ', 'τ']
    """
    unknown = [name for name in names if name not in TERMS]
    if unknown:
        raise InputError("names", unknown[0], "is not explained; add it to TERMS")
    return Glossary(TITLE, tuple((name, meaning) for name, meaning in TERMS.items() if name in names))
