"""Ensembles on a GPU: the same scalar functions and the same random numbers as on the processor."""
