"""Random numbers, Brownian increments and backlash draws as functions of seed, path and step."""
