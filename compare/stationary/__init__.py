"""The stationary motion of a scene: long-run averages, and which closure predicts them."""
