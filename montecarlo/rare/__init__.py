"""Rare branches sampled on purpose: a mixture of plain paths and of paths drawn near design points, with weights."""
