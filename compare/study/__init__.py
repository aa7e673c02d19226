"""Parameter studies: grids over any field of a scene; every cell is computed once, stored, and
combined into tables."""
