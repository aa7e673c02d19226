"""Plugins of the project's own tests; its plugin for accuracy thresholds is named in case it has not been installed."""

pytest_plugins = ["pytester", "rattle.compare.thresholds.plugin"]
