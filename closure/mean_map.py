"""The public entry of the closures: one call, four closures, one kind of result."""

from collections.abc import Callable
from typing import NamedTuple

from rattle.closure import corrected as corrected
from rattle.closure import published as published
from rattle.closure import saltation
from rattle.closure.branching import trace as branching
from rattle.closure.moments import Trace
from rattle.closure.result import MeanMap
from rattle.scene.errors import InputError
from rattle.scene.scene import Scene
from rattle.scene.validate import choice, count, positive

__all__ = ["CLOSURES", "Closure", "closures_for", "mean_map", "refusals"]


class Closure(NamedTuple):
    """A closure: how it is evaluated, and for which scenes.

    Attributes
    ----------
    trace : callable
        ``trace(scene, impacts, order)``, returns a `Trace`.
    check : callable
        ``check(scene)``, raises InputError for a scene to which the closure does not apply.
    refines : bool
        Whether `trace` takes a tolerance as its last argument, and is then as coarse as that allows.
    """

    trace: Callable[..., Trace]
    check: Callable[[Scene], None] = lambda scene: None
    refines: bool = False


CLOSURES = {
    "published": Closure(published.trace, published.check),
    "corrected": Closure(corrected.trace),
    "saltation": Closure(saltation.trace),
    "branching": Closure(branching.trace, refines=True),
}
"""The closures, by name."""

ORDERS = (2, 6)
MOST_IMPACTS = 100_000  # an impact takes some kilobytes; for longer orbits see rattle.closure.long_orbit


def mean_map(
    scene: Scene, *, impacts: int = 12, closure: str = "saltation", order: int = 4, tolerance: float | None = None
) -> MeanMap:
    """Predict the moments of the first impacts of a scene by a moment closure.

    Parameters
    ----------
    scene : Scene
        What is modelled.
    impacts : int
        How many impacts after the start.
    closure : {"saltation", "branching", "corrected", "published"}
        Which closure (docs/model.md section 6).  ``saltation`` is asymptotically exact for small noise.  ``branching``
        is a mixture over the different itineraries that paths take under larger noise, and predicts their shares too.
    order : int
        Highest order of the moments in the Edgeworth series, 2 to 6.  ``saltation`` has first-order means and sds at
        order 2, and adds mean shifts and skewness from order 3 on.
    tolerance : float, optional
        Of ``branching``: the largest error of a mean, in sds, and half the largest of an sd, that is allowed.  The
        closure refines itself until its own bound is below, or its finest level is reached; without a tolerance it
        uses the finest level.  `MeanMap.advice` says whether the tolerance is met.

    Returns
    -------
    MeanMap
        The prediction.

    Raises
    ------
    InputError
        For an unknown closure, an order out of range, a scene to which the closure does not apply, or a tolerance that
        is not positive or is given to a closure that cannot refine itself.

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene
    >>> m = mean_map(Scene.from_gears(DAT21, sigma=1.5**0.5), impacts=4, closure="published")
    >>> m.breakdown.impact
    2
    """
    if not isinstance(scene, Scene):
        raise InputError("scene", scene, "give a Scene")
    count("impacts", impacts, most=MOST_IMPACTS)
    choice("closure", closure, CLOSURES)
    count("order", order, *ORDERS)
    CLOSURES[closure].check(scene)
    asked: tuple[float, ...] = ()
    if tolerance is not None:
        positive("tolerance", tolerance)
        if not CLOSURES[closure].refines:
            able = ", ".join(name for name, of in CLOSURES.items() if of.refines)
            raise InputError(
                "tolerance", tolerance, f"closure {closure!r} cannot refine itself; leave it out, or use {able}"
            )
        asked = (tolerance,)
    return MeanMap(scene, closure, impacts, order, CLOSURES[closure].trace(scene, impacts, order, *asked), tolerance)


def refusals(scene: Scene) -> dict[str, str]:
    """The closures that do not apply to a scene, and why.

    Parameters
    ----------
    scene : Scene
        What is modelled.

    Returns
    -------
    dict of str to str
        Reason by name of the closure; empty if all apply.

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene, Start
    >>> refusals(Scene.from_gears(DAT21, start=Start()))
    {'published': 'start.mesh = 0: the published closure needs a start at mesh 1 (Eq. 10)'}
    """
    found = {}
    for name, closure in CLOSURES.items():
        try:
            closure.check(scene)
        except InputError as error:
            found[name] = str(error)
    return found


def closures_for(scene: Scene) -> tuple[str, ...]:
    """The closures that apply to a scene.

    Parameters
    ----------
    scene : Scene
        What is modelled.

    Returns
    -------
    tuple of str
        Their names.

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene, Start
    >>> closures_for(Scene.from_gears(DAT21, start=Start()))
    ('corrected', 'saltation', 'branching')
    """
    refused = refusals(scene)
    return tuple(name for name in CLOSURES if name not in refused)
