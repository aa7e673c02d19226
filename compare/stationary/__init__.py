"""The stationary motion of a scene: what rattles for hours, and which closure can say any of it."""
