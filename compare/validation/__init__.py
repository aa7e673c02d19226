"""Closures compared with a simulation of the same scene: errors, intervals, verdicts, figures, the
page."""
