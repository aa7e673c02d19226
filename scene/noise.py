"""What the noise of a scene acts on: the drive, which it modulates, or wheels and bodies, on which
it is a random force.

Sources are independent white noises, each of its own intensity in units of `sigma`.  The first is
common to all of the scene, for the drive moves all wheels; every other acts on one wheel alone.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from rattle.scene.errors import InputError, non_negative
from rattle.scene.parts import LARGEST_RATE, LEAST_SIZE

DRIVE_NOISE = "drive"
"""What the noise acts on by default."""

NoiseSources = str | int | tuple[tuple[str, float], ...]
"""One source by name or number; or several by name, each with its intensity over `sigma`."""


def read_noise(noise: Any, names: Sequence[str]) -> NoiseSources:
    """`Scene.noise` as it is kept, or say what is wrong with it.

    `names`: of the wheels.
    """
    if not isinstance(noise, Mapping | tuple | list):
        _find(noise, names)
        return noise  # type: ignore[no-any-return]
    try:
        given = dict(noise)
    except (TypeError, ValueError):
        raise InputError("noise", noise, "give a name, or a table of name and intensity") from None
    known = [DRIVE_NOISE, *names]
    kept = []
    for name, intensity in given.items():
        number = _find(name, names)
        field = f"noise.{name}"
        size = non_negative(field, intensity, LEAST_SIZE, LARGEST_RATE)
        if number == 0 and size not in (0.0, 1.0):
            why = "that of the drive is sigma itself: 1, and the others in units of it"
            raise InputError(field, intensity, why)
        if size:
            kept.append((known[number], float(size)))
    if not kept or len(dict(kept)) < len(kept):
        raise InputError("noise", noise, "give each source once, and one that is not 0")
    first, size = kept[0]
    return first if len(kept) == 1 and size == 1.0 else tuple(kept)


def list_sources(noise: NoiseSources, names: Sequence[str]) -> list[tuple[int, float]]:
    """The number of the wheel that each source acts on, 0 for the drive, with its intensity over
    `sigma`; in ascending order."""
    if not isinstance(noise, tuple):
        return [(_find(noise, names), 1.0)]
    return sorted((_find(name, names), intensity) for name, intensity in noise)


def _find(name: Any, names: Sequence[str]) -> int:
    """The number of the wheel that is named, 0 for the drive."""
    known = [DRIVE_NOISE, *names]
    if type(name) is str and name in known:
        return known.index(name)
    if type(name) is int and 0 < name <= len(names):
        return name
    raise InputError("noise", name, f"what it acts on is one of: {', '.join(known)}")
