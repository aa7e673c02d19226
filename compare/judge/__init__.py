"""Predicted moments judged by samples of any simulation: the comparison itself, which knows no
gears."""
