"""Where each scheme is stable and unbiased, measured, and whether the door of the sampler stands in the right place."""
