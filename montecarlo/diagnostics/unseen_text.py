"""What a sample cannot have seen, in words."""

import numpy as np

from rattle.scene.text import percent


def unseen_text(moment: str, probability: float, change: float, needed: float) -> str:
    """The unseen of a row in words."""
    if not np.isfinite(needed):
        return (
            "rare branches are not known here; one that so many paths may miss could change this "
            f"{moment} by {percent(change)}"
        )
    return (
        f"a rare branch ({share_of(probability)} paths) is missing from the sample: it could change"
        f" this {moment} by {percent(change)}{' of an sd' if moment == 'mean' else ''};"
        f" {_count(needed)} paths would settle it"
    )


def share_of(probability: float) -> str:
    """A small share in words."""
    for per, name in ((1e3, "a thousand"), (1e6, "a million"), (1e9, "a billion")):
        if probability * per >= 1.0:
            return f"about {probability * per:.0f} in {name}"
    return f"about {probability:.0e} of the"


def _count(paths: float) -> str:
    unit = 10.0 ** (np.floor(np.log10(paths)) - 1.0)
    rounded = float(np.ceil(paths / unit - 1e-9) * unit)
    for size, name in ((1e9, "billion"), (1e6, "million")):
        if rounded >= size:
            return f"{rounded / size:.3g} {name}"
    return f"{rounded:,.0f}"
