"""Accuracy thresholds in pytest: a marker that claims how accurate a closure is, and a fixture that holds it to that.

The entry point names this package, which names the plugin: so it is registered once, however it was asked for.
"""

pytest_plugins = ("rattle.compare.thresholds.plugin",)
