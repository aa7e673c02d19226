"""Accuracy thresholds in pytest: a marker that claims the accuracy of a closure, and a fixture that
tests the claim.

The entry point names this package, and the package names the plugin, so that it is registered only
once.
"""

pytest_plugins = ("rattle.compare.thresholds.plugin",)
