"""Checks at extreme parameter values against independent references.

The references are the formulas in 400 digits, limits, published results, and exact scaling relations.
"""

from rattle.compare.checks.check import EXTREMES, collect
from rattle.compare.checks.extremes import formulas, runs

ROWS = collect(EXTREMES, formulas, runs)
"""Every check by the name of its function."""
