"""Branches of the motion beside the noise-free orbit: the search for them, and how rare they
are."""
