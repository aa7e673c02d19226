"""Ensemble studies: grids over any field of a scene, computed once, kept, and put together."""
