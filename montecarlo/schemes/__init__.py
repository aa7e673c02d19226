"""Numerical schemes: how each advances a path by a step, and which steps are admissible."""
