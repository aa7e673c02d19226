"""Paths that share their noise: one Brownian tree under two of them, or under one for as long as wanted."""
