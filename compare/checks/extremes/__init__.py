"""Checks at extreme parameter values against independent references.

The references are the formulas in 400 digits, limits, published results, and exact scaling
relations.
"""

from rattle.compare.checks.check import EXTREMES, Subject
from rattle.compare.checks.extremes import formulas, runs

ROWS: dict[str, Subject] = {name: (vars(formulas) | vars(runs))[name] for name in EXTREMES}
"""Every check by the name of its function."""
