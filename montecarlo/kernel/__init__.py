"""Computation of a block of paths: vector lanes, steps, impacts, and the reduction to sums."""
