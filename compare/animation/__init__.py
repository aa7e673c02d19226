"""An animation of the rattling wheels: the noise-free orbit beside one noisy path, as one self-contained HTML file."""

from rattle.compare.animation.page import animation, check_file, write_animation
from rattle.compare.animation.record import Motion, Recording, record

__all__ = ["Motion", "Recording", "animation", "check_file", "record", "write_animation"]
