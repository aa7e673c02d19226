"""Validations over a grid of noise intensities: how far each closure holds, and what it saves there."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from tqdm import tqdm

from rattle.compare.validation.speed import Speed, path_seconds, speed
from rattle.compare.validation.validate import validate
from rattle.compare.validation.validity import Validity, validities
from rattle.montecarlo import check_settings, default_step
from rattle.scene.errors import InputError
from rattle.scene.scene import Scene
from rattle.scene.validate import count, positive

__all__ = ["Sweep", "check_sweep", "grid", "sweep"]

EXAMPLE = "1e-3:2:12"
SCHEME = "exact-flight"
"""Without a bias in the step, which would outgrow the tolerances as they shrink with sigma."""


class Sweep(NamedTuple):
    """Frontiers of all closures at all noise intensities, which repeat bit for bit, and timings, which do not."""

    validity: pd.DataFrame
    speed: pd.DataFrame


def grid(text: str) -> tuple[float, ...]:
    """Noise intensities from ``LOW:HIGH:POINTS``, evenly spaced in their logarithm, rounded to three digits.

    Raises
    ------
    InputError
        Names what is wrong with the text.

    Examples
    --------
    >>> grid("0.01:1:3")
    (0.01, 0.1, 1.0)
    """
    words = text.split(":")
    try:
        low, high, points = float(words[0]), float(words[1]), int(words[2])
    except (ValueError, IndexError):
        raise InputError("validity", text, f"give LOW:HIGH:POINTS, as in {EXAMPLE}") from None
    if len(words) > 3:
        raise InputError("validity", text, f"give LOW:HIGH:POINTS, as in {EXAMPLE}")
    positive("validity LOW", low)
    if positive("validity HIGH", high) <= low:
        raise InputError("validity HIGH", high, f"must be greater than LOW = {low:g}")
    count("validity POINTS", points, least=2)
    found = tuple(float(f"{s:.3g}") for s in np.geomspace(low, high, points))
    if len(set(found)) < points:
        raise InputError("validity POINTS", points, f"are more than {low:g} and {high:g} can hold; take fewer")
    return found


def check_sweep(scene: Scene, sigmas: Sequence[float], **settings: Any) -> None:
    """Refuse a sweep that could not be run to its end, before any work; settings as of `montecarlo.check_settings`.

    Raises
    ------
    InputError
        Names the noise intensity, what is wrong there, and the remedy.
    """
    for sigma in sigmas:
        try:
            own = scene.with_sigma(sigma)
            check_settings(own, scheme=SCHEME, dt=default_step(own, SCHEME), step_bias=False, **settings)
        except InputError as error:
            raise InputError("validity", sigma, f"cannot be run ({error}); change the range, or leave it out") from None


def sweep(scene: Scene, sigmas: Sequence[float], *, workers: int, **settings: Any) -> Sweep:
    """Validate a scene at each noise intensity against exact flights, all from one seed.

    Parameters
    ----------
    scene : Scene
        What is modelled; its own noise intensity is not used.
    sigmas : sequence of float
        Noise intensities.  All have the same random numbers, so that what changes along the grid is not the sample.
    workers : int
        Threads of the simulations.
    **settings
        Of `validate`.

    Returns
    -------
    Sweep
    """
    found: list[pd.DataFrame] = []
    timed: list[Speed] = []
    for sigma in tqdm(sigmas, desc="validity", unit="sigma", disable=None):
        v = validate(scene.with_sigma(sigma), scheme=SCHEME, workers=workers, **settings)
        found.append(validities([v]))
        seconds = path_seconds(v)
        timed += [s for closure in v.predictions if (s := speed(v, closure, seconds))]
    return Sweep(
        pd.concat(found, ignore_index=True)[list(Validity._fields)], pd.DataFrame(timed, columns=list(Speed._fields))
    )
