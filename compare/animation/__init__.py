"""An animation of rattling wheels or bouncing bodies: the noise-free orbit beside one noisy path,
as one self-contained HTML file."""
