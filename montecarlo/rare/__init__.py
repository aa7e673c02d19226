"""Rare branches: paths whose noise is drawn near the design points of other events than the orbit's."""
