"""One side held against the other: moment errors with intervals, validity of the correlation, reports."""

from compare.moments import Tolerances
from compare.validate import Validation, validate

__all__ = ["Tolerances", "Validation", "validate"]
