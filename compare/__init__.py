"""Comparison of the closures with the Monte Carlo: errors of moments with intervals, verdicts,
studies, reports."""
