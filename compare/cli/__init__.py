"""The command ``rattle``, a module for each of its commands."""
