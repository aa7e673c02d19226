"""One side held against the other: moment errors with intervals, validity of the correlation, reports."""
