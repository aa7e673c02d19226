"""Measures where each scheme is stable and unbiased, and whether input validation limits the time
step correctly.

`rattle.montecarlo.largest_step` gives the longest admissible step.  Cells with longer steps are
measured as well, to show that the limit is needed.
"""
