"""Validations over a grid of noise intensities: range of validity and speed-up of each closure."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from tqdm import tqdm

from rattle.compare.validation.comparison import Sweep
from rattle.compare.validation.speed import measure_speeds, simulation_costs
from rattle.compare.validation.validate import validate
from rattle.compare.validation.validity import find_validities
from rattle.montecarlo import check_settings, default_step
from rattle.scene.errors import InputError
from rattle.scene.scene import Scene
from rattle.scene.validate import count, positive

EXAMPLE = "1e-3:2:12"
SCHEME = "exact-flight"
"""Has no step bias, which would exceed the tolerances at small sigma, as they are shares of the sds."""


def read_grid(text: str) -> tuple[float, ...]:
    """Noise intensities from ``LOW:HIGH:POINTS``, evenly spaced in their logarithm, rounded to three digits.

    Examples
    --------
    >>> read_grid("0.01:1:3")
    (0.01, 0.1, 1.0)
    """
    try:
        first, last, number = text.split(":")
        low, high, points = float(first), float(last), int(number)
    except ValueError:
        raise InputError("validity", text, f"give LOW:HIGH:POINTS, as in {EXAMPLE}") from None
    positive("validity LOW", low)
    if positive("validity HIGH", high) <= low:
        raise InputError("validity HIGH", high, f"must be greater than LOW = {low:g}")
    count("validity POINTS", points, least=2)
    found = tuple(float(f"{s:.3g}") for s in np.geomspace(low, high, points))
    if len(set(found)) < points:
        why = f"cannot be told apart by three digits between {low:g} and {high:g}; take fewer"
        raise InputError("validity POINTS", points, why)
    return found


def check_sweep(scene: Scene, sigmas: Sequence[float], **settings: Any) -> None:
    """Validate the input of a sweep before any work starts."""
    for sigma in sigmas:
        try:
            own = scene.with_sigma(sigma)
            check_settings(own, scheme=SCHEME, dt=default_step(own, SCHEME), step_bias=False, **settings)
        except InputError as error:
            raise InputError("validity", sigma, f"cannot be run ({error}); change the range, or leave it out") from None


def sweep(scene: Scene, sigmas: Sequence[float], *, workers: int, **settings: Any) -> Sweep:
    """Validate a scene at each noise intensity against exact flights, all from one seed.

    `sigmas`: Noise intensities.  All use the same random numbers, so that the sample does not change along the
    grid.
    """
    own = [
        validate(scene.with_sigma(sigma), scheme=SCHEME, workers=workers, **settings)
        for sigma in tqdm(sigmas, desc="validity", unit="sigma", disable=None)
    ]
    return Sweep(find_validities(own), measure_speeds(own), simulation_costs(own))
