"""The run-up of gears: rattle while the speed changes slowly, and at constant speeds."""
