"""The public entry of the closures: one call, four closures, one kind of result."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

from rattle.closure import branching, corrected, published, saltation
from rattle.closure.branching import RESOLUTIONS
from rattle.closure.closure import Closure, OwnError, describe_error, import_closure, name_of
from rattle.closure.moments import (
    COMPONENT_MICROSECONDS,
    Trace,
    cost_factor,
)
from rattle.closure.result import MeanMap
from rattle.scene import InputError, Scene, check_each_impact, check_scene, choice, count, positive
from rattle.scene.numpy_errors import numpy_defaults


@dataclass(frozen=True)
class BuiltIn(Closure):
    """A closure of the package: an entry of `CLOSURES`, which answers what one's own answers."""

    # ``function(scene, impacts, order)``, with a tolerance as its last where it refines
    function: Callable[..., Trace]
    # raises InputError for a scene to which it does not apply
    applies: Callable[[Scene], None] = lambda scene: None
    color: str = ""
    marker: str = ""
    limit: str = "fixed time"
    describes: str = "itinerary"
    refines: bool = False
    # of one core, components not counted; measured once on DAT21 and the examples
    impact_microseconds: float = 0.0
    components: int = 0  # the most that it follows

    own: ClassVar[bool] = False
    digest = reference = ""  # its source is in the version of the package, and its name finds it

    def __repr__(self) -> str:
        return f"<closure {self.name!r} of the package>"

    def __reduce__(self) -> tuple[Callable[[str], Closure], tuple[str]]:
        """Pickled by its name."""
        return built_in, (self.name,)

    def check(self, scene: Scene) -> None:
        """Refuse a scene to which it does not apply."""
        self.applies(scene)

    def trace(self, scene: Scene, impacts: int, order: int, *tolerance: float) -> Trace:
        """Follow the moments through the impacts."""
        return self.function(scene, impacts, order, *tolerance)

    def seconds(self, trace: Trace, impacts: int) -> float:
        """Nominal seconds of one core up to an impact: counted impacts and flights of components,
        at stated costs."""
        followed = min(trace.found, impacts)
        flown = int(trace.flown[: impacts + 1].sum())
        counted = followed * self.impact_microseconds + flown * COMPONENT_MICROSECONDS
        return 1e-6 * counted * cost_factor(trace.wheels)

    def most_seconds(self, impacts: int, wheels: int) -> float:
        """The most that `seconds` can be: all components that it may have."""
        of_impact = self.impact_microseconds + self.components * COMPONENT_MICROSECONDS
        return 1e-6 * impacts * of_impact * cost_factor(wheels)


_TABLE = (
    BuiltIn(
        "published",
        published.trace,
        applies=published.check,
        color="#D55E00",
        marker="s",
        impact_microseconds=200.0,
    ),
    BuiltIn(
        "corrected",
        corrected.trace,
        applies=corrected.check,
        color="#0072B2",
        marker="o",
        impact_microseconds=50.0,
    ),
    BuiltIn(
        "saltation",
        saltation.trace,
        applies=check_each_impact,
        color="#009E73",
        marker="^",
        limit="second order",
        impact_microseconds=250.0,
    ),
    BuiltIn(
        "branching",
        branching.trace,
        applies=branching.check,
        color="#E69F00",
        marker="v",
        describes="all paths",
        refines=True,
        impact_microseconds=300.0,
        components=sum(level.cut for level in RESOLUTIONS[-2:]),
    ),
)
CLOSURES = {closure.name: closure for closure in _TABLE}
"""The closures of the package, by name."""
Closure.taken |= set(CLOSURES)

ORDER_RANGE = (2, 6)
# an impact takes some kilobytes; for longer orbits see rattle.scene.long_orbit
MOST_IMPACTS_OF_A_MAP = 100_000


@numpy_defaults
def mean_map(
    scene: Scene,
    *,
    impacts: int = 12,
    closure: str | Closure | Callable[..., Any] = "saltation",
    order: int = 4,
    tolerance: float | None = None,
) -> MeanMap:
    """Predict the moments of the first impacts of a scene by a moment closure.

    Parameters
    ----------
    scene : Scene
        What is modelled.
    impacts : int
        How many impacts after the start.
    closure : {"saltation", "branching", "corrected", "published"}, Closure or callable
        Which closure (docs/model.md section 6).  ``saltation`` is asymptotically exact for small
        noise.  ``branching`` is a mixture over the different itineraries that paths take under
        larger noise, and predicts their shares too. Or one's own: a `Closure`, a function ``(scene,
        impacts)``, or ``package.module:function``.
    order : int
        Highest order of the moments in the Edgeworth series, 2 to 6.  ``saltation`` has first-order
        means and sds at order 2, and adds mean shifts and skewness from order 3 on.
    tolerance : float, optional
        Of ``branching``: the largest error of a mean, in sds, and half the largest of an sd, that
        is allowed.  The closure refines itself until its own bound is below, or its finest level is
        reached; without a tolerance it uses the finest level.  `MeanMap.advice` says whether the
        tolerance is met.

    Returns
    -------
    MeanMap
        The prediction.

    Raises
    ------
    InputError
        For an unknown closure, an order out of range, a scene to which the closure does not apply,
        or a tolerance that is not positive or is given to a closure that cannot refine itself; for
        a table of one's own closure that lacks impacts, has an unknown column, or holds no numbers.

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene
    >>> m = mean_map(Scene.from_gears(DAT21, sigma=1.5**0.5), impacts=4, closure="published")
    >>> m.breakdown.impact
    2
    """
    try:
        return _predict(scene, find_closure("closure", closure), impacts, order, tolerance)
    except OwnError as error:
        raised = error.raised
    # outside of the handler, so that its traceback is that of the user's function alone
    raise raised


def _predict(
    scene: Scene, method: Closure, impacts: int, order: int, tolerance: float | None = None
) -> MeanMap:
    """`mean_map`, which raises `OwnError` where a function of one's own raises an exception."""
    check_scene(scene)
    count("impacts", impacts, most=MOST_IMPACTS_OF_A_MAP)
    count("order", order, *ORDER_RANGE)
    method.check(scene)
    asked = [] if tolerance is None else [positive("tolerance", tolerance)]
    if asked and not method.refines:
        able = ", ".join(name for name, of in CLOSURES.items() if of.refines)
        why = f"closure {method.name!r} cannot refine itself; leave it out, or use {able}"
        raise InputError("tolerance", tolerance, why)
    trace = method.trace(scene, impacts, order, *asked)
    return MeanMap(scene, method, impacts, order, trace, tolerance)


def predict(scene: Scene, method: Closure, impacts: int, order: int) -> MeanMap:
    """`mean_map`; where a function of one's own raises an exception, nothing is predicted, and
    `stopped` says what."""
    try:
        return _predict(scene, method, impacts, order)
    except OwnError as error:
        why = describe_error(error.raised)
        return MeanMap(scene, method, impacts, order, method.trace_failure(scene, impacts, why))


def built_in(name: str) -> Closure:
    """The closure of the package of a name."""
    return CLOSURES[name]


def find_closure(field: str, given: object) -> Closure:
    """The closure of a name, of ``package.module:function``, or of a function of one's own."""
    if isinstance(given, Closure):
        return given
    if isinstance(given, str):
        return (
            import_closure(field, given)
            if ":" in given
            else CLOSURES[choice(field, given, CLOSURES)]
        )
    if callable(given):
        return Closure(name_of(given), given)
    why = "give the name of a closure, package.module:function, or a function (scene, impacts)"
    raise InputError(field, given, why)


def find_closures(field: str, given: object) -> tuple[Closure, ...]:
    """Several closures, each once, whose names differ."""
    if not isinstance(given, list | tuple) or not given:
        raise InputError(
            field, given, f"give a list of {', '.join(CLOSURES)}, or functions of your own"
        )
    closures: dict[str, Closure] = {}
    for item in given:
        closure = find_closure(field, item)
        if closures.setdefault(closure.name, closure) != closure:
            why = (
                f"is the name of two closures; give one another, as in Closure('{closure.name}2',"
                " function)"
            )
            raise InputError(field, closure.name, why)
    return tuple(closures.values())


@numpy_defaults
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
    reasons = {}
    for name, closure in CLOSURES.items():
        try:
            closure.check(scene)
        except InputError as error:
            reasons[name] = str(error)
    return reasons


@numpy_defaults
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


def closure_seconds(found: MeanMap, impacts: int | None = None) -> float:
    """Seconds of one core that a prediction takes: nominal, or measured where a user's own function
    made it.

    `impacts`: Up to which the work is counted, not measured; all by default.
    """
    return found.method.seconds(found.trace, found.impacts if impacts is None else impacts)
