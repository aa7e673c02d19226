"""Checks of the installed program, and of the paper: published results, claims, extreme values,
stability and bias."""
