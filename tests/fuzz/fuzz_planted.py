"""Jobs with known ends, for the test of the watch."""

import os
import time

__all__ = ["controls"]


def controls(kind):
    if kind == "hangs":
        time.sleep(60.0)
    if kind == "dies":
        os._exit(3)
    if kind == "warns":
        import numpy as np

        np.sqrt(np.array([-1.0]))
    return "complete", kind
