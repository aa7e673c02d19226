"""Extreme values held against truths of their own: higher precision, limit formulas, published laws, exact scaling."""
