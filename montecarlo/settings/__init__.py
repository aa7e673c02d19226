"""What a run is asked for: its settings, what it records, how paths are sampled, and its budget of time."""
