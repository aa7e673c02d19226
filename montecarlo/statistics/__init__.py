"""Reduction of paths to statistics: central sums, histograms, batches, and the step bias."""
