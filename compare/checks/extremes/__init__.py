"""Checks at extreme parameter values against independent references.

The references are the formulas in 400 digits, limits, published results, and exact scaling relations.
"""
