"""Where each scheme is stable and unbiased, measured, and whether the door of the sampler stands in the right place."""

from compare.stability.axes import AXES
from compare.stability.chart import Chart, chart

__all__ = ["AXES", "Chart", "chart"]
