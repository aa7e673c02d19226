"""Settings of `simulate`: those that several files take, and as one flat dictionary for tests that
vary them."""

import math
from dataclasses import fields

from rattle import Record, Sampling

EULER = "euler-maruyama"
LOCATED = "euler-maruyama-located"
EXACT = "exact-flight"
USEFUL_STEP = {EULER: 5e-3, LOCATED: 5e-3, EXACT: math.pi / 64.0}
"""A step at which each scheme is of use."""
ON_ITINERARY = Record(on_itinerary=True)
STEP_BIAS = Record(step_bias=True)

GATHERED = {"record": Record, "sampling": Sampling}


def recorded(settings):
    """The settings with those of `Record` and of `Sampling` gathered into one each."""
    given = dict(settings)
    for name, kind in GATHERED.items():
        own = {field.name: given.pop(field.name) for field in fields(kind) if field.name in given}
        if own:
            given[name] = kind(**own)
    return given
