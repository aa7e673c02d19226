"""Paths on a shared Brownian tree: two of them on the same noise, or one for as long as wanted."""
