"""How far a finished run can be trusted: its accuracy, what it cannot have seen, and the same in
sentences."""
