"""How a block of paths is computed: lanes side by side, steps, impacts, and what is kept of them."""
