"""A run to an accuracy: what paths cost, pilot runs, and how many paths and which step it takes."""
