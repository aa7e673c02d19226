"""Checks of the installed program: published results, extreme values, stability and bias of the schemes."""
