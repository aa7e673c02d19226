"""What is kept of the paths: central sums, histograms, batches, and the bias of the step."""
