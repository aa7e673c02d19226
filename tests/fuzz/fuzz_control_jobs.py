"""Jobs with known ends: negative controls of the watched process."""

import os
import time

__all__ = ["ends_as_named"]


def ends_as_named(kind):
    if kind == "waits":
        time.sleep(60.0)
    while kind == "loops":
        pass
    if kind == "dies":
        os._exit(3)
    if kind == "warns":
        import numpy as np

        np.sqrt(np.array([-1.0]))
    return "complete", kind
