"""An ensemble of paths over a number of impacts: the simulation and its result."""
