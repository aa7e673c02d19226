"""Which parameter of the gears changes the rattle, and by how much."""
