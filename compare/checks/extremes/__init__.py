"""Checks at extreme parameter values against independent references.

The references are the formulas in 400 digits, limits, published results, and exact scaling relations.
"""

from rattle.compare.checks.check import Subject
from rattle.compare.checks.extremes import formulas, impacts, invariance, sampling

ROWS: dict[str, Subject] = {
    row.__name__: row
    for part in (formulas.FLIGHTS, impacts.ROWS, formulas.ROWS, sampling.ROWS, invariance.ROWS)
    for row in part
}
"""Every check by the name of its function."""
