"""An animation of the rattling wheels: the noise-free orbit beside one noisy path, as one
self-contained HTML file."""
