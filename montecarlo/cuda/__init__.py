"""Ensembles on a GPU: the same scalar steps, the same random numbers."""
