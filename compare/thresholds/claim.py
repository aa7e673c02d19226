"""What a test claims of a closure: read from its marker and checked before anything is simulated."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from rattle.compare.thresholds.settings import UNDECIDED
from rattle.compare.validation.verdict import Tolerances
from rattle.montecarlo import SCHEMES, check_settings, default_step
from rattle.montecarlo.settings import MOST_PATHS
from rattle.scene.errors import FileError, InputError
from rattle.scene.moments import SECTION, STATE
from rattle.scene.scene import Scene
from rattle.scene.validate import choice, count, known_keys, positive

__all__ = ["Allowed", "Claim", "Row", "merged", "read_claim"]

MOMENTS = ("mean", "sd")
OPTIONS = (
    "scene", "impacts", "quantities", "moments", "within", "absolute", "paths", "budget", "accuracy", "scheme",
    "undecided",
)  # fmt: skip
RIVALS = ({"within", "absolute"}, {"paths", "accuracy"}, {"budget", "accuracy"})
"""Options that say the same thing in two ways."""
FEWEST = 1024
"""Paths of which a standard error can be believed; two have none of an sd."""
VARYING = ("tau", "y1", "y2")
"""Quantities that vary at every impact; a displacement is not judged at the mesh that is struck."""


class Row(NamedTuple):
    """One check."""

    moment: str
    quantity: str
    impact: int

    @property
    def column(self) -> str:
        """Where a section table holds it."""
        return self.quantity if self.moment == "mean" else f"sd_{self.quantity}"


class Allowed(NamedTuple):
    """How large an error may be: in sds of the quantity, or absolute."""

    error: float
    in_sd: bool


@dataclass(frozen=True)
class Claim:
    """That section moments of a closure are right within a tolerance.

    Attributes
    ----------
    scene : Scene
    impacts : tuple of int
        Impacts that are checked, ascending.
    quantities : tuple of str
        Of `rattle.scene.moments.SECTION`.
    allowed : dict of str to Allowed
        For each of the moments, ``mean`` and ``sd``.
    paths : int or None
        Simulated paths to begin with; None for those of the session's profile.
    budget : int or None
        Most paths while it is undecided; None for what the session says.
    accuracy : float or None
        Or simulate to this accuracy, see `montecarlo.simulate`.
    scheme : str
        Of the simulation.
    undecided : str or None
        What becomes of the test if its budget cannot decide it, ``fail`` or ``skip``; None for what the session says.
    """

    scene: Scene
    impacts: tuple[int, ...]
    quantities: tuple[str, ...]
    allowed: Mapping[str, Allowed]
    paths: int | None = None
    budget: int | None = None
    accuracy: float | None = None
    scheme: str = "exact-flight"
    undecided: str | None = None

    @cached_property
    def rows(self) -> tuple[Row, ...]:
        """Every check that it makes."""
        return tuple(Row(m, q, k) for m in self.allowed for q in self.quantities for k in self.impacts)

    @property
    def columns(self) -> tuple[str, ...]:
        """What a model has to predict."""
        return tuple(dict.fromkeys(row.column for row in self.rows))


def merged(markers: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Options of a test's markers, nearest first: a nearer one's replace those of its class or module.

    Examples
    --------
    >>> merged([{"absolute": 1e-3}, {"scene": "dat21.toml", "within": 0.05}])
    {'scene': 'dat21.toml', 'absolute': 0.001}
    """
    found: dict[str, Any] = {}
    for options in reversed(list(markers)):
        replaced = {name for rivals in RIVALS if rivals & options.keys() for name in rivals}
        found = {name: value for name, value in found.items() if name not in replaced} | dict(options)
    return found


def read_claim(options: Mapping[str, Any], folder: Path) -> Claim:
    """The claim that a marker makes.

    Parameters
    ----------
    options : mapping
        Of the marker: ``scene`` (a Scene, or a TOML file), ``impacts`` (the first so many, or a list), ``quantities``,
        ``moments``, ``within`` (allowed error in sds of the quantity) or ``absolute``, each a number or one for each
        moment, ``paths`` and ``budget`` or ``accuracy``, ``scheme``, and ``undecided``.
    folder : Path
        Where a scene file is looked for: the test's own.

    Raises
    ------
    InputError
        Names the option, its value and the remedy.

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> claim = read_claim({"scene": Scene.from_gears(DAT21, sigma=0.1), "impacts": 2, "within": 0.05}, Path())
    >>> len(claim.rows), claim.rows[0], claim.allowed["sd"]
    (12, Row(moment='mean', quantity='tau', impact=1), Allowed(error=0.05, in_sd=True))
    """
    known_keys("option of the marker rattle", options, OPTIONS)
    scene = _scene(options.get("scene"), folder).phase_reduced  # a late start costs no digits
    stated = STATE[: 2 * scene.stages]
    valid = [q for q in SECTION if q not in STATE or q in stated]
    quantities = _names("quantities", options.get("quantities", [q for q in VARYING if q in valid]), valid)
    moments = _names("moments", options.get("moments", MOMENTS), MOMENTS)
    impacts = _impacts(options.get("impacts", 4))
    paths, budget, accuracy = (options.get(name) for name in ("paths", "budget", "accuracy"))
    for name, value in (("paths", paths), ("budget", budget)):
        if value is not None and accuracy is not None:
            raise InputError("accuracy", accuracy, f"chooses the number of paths itself; leave out {name} = {value!r}")
    if accuracy is not None:
        positive("accuracy", accuracy)
    if paths is not None:
        count("paths", paths, least=FEWEST)
    if budget is not None:
        count("budget", budget, most=MOST_PATHS)
    if (undecided := options.get("undecided")) is not None:
        choice("undecided", undecided, UNDECIDED)
    kind = SCHEMES[choice("scheme", scheme := options.get("scheme", "exact-flight"), SCHEMES)]
    biased = kind.has_step_bias
    check_settings(
        scene, paths=1 if paths is None else paths, impacts=impacts[-1], scheme=scheme, rng=0, workers=1,
        dt=default_step(scene, scheme, biased) if accuracy is None else None, step_bias=biased,
    )  # fmt: skip
    return Claim(scene, impacts, quantities, _allowed(options, moments), paths, budget, accuracy, scheme, undecided)


def _scene(given: object, folder: Path) -> Scene:
    if isinstance(given, Scene):
        return given
    if not isinstance(given, str | Path):
        raise InputError("scene", given, "give a Scene, or the name of a TOML file beside the test")
    path = folder / given
    if not path.is_file():
        raise FileError("scene", str(given), f"there is no file {path}; give one that is, relative to the test")
    try:
        return Scene.load(path)
    except InputError as error:
        raise InputError("scene", str(given), f"is not a scene ({error})") from None


def _names(field: str, given: object, valid: Iterable[str]) -> tuple[str, ...]:
    names = (given,) if isinstance(given, str) else given
    if not isinstance(names, Iterable) or not (listed := list(names)):
        raise InputError(field, given, "give a list of " + ", ".join(map(repr, valid)))
    return tuple(dict.fromkeys(choice(field, name, valid) for name in listed))


def _impacts(given: object) -> tuple[int, ...]:
    if not isinstance(given, Iterable) or isinstance(given, str):
        return tuple(range(1, count("impacts", given) + 1))
    found = tuple(sorted({count("impacts", impact) for impact in given}))
    if not found:
        raise InputError("impacts", given, "give how many, or a list such as range(1, 5)")
    return found


def _allowed(options: Mapping[str, Any], moments: tuple[str, ...]) -> dict[str, Allowed]:
    """The allowed error of each moment; by default what the project calls accurate."""
    found: dict[str, Allowed] = {}
    given = {name: options[name] for name in ("within", "absolute") if options.get(name) is not None}
    for name, value in (given or {"within": {m: getattr(Tolerances(), m) for m in moments}}).items():
        each = dict(value) if isinstance(value, Mapping) else dict.fromkeys(moments, value)
        for moment, error in each.items():
            if choice(f"moment of {name}", moment, MOMENTS) not in moments:
                raise InputError(name, value, f"{moment!r} is not among moments = {moments!r}; add it, or leave it out")
            if moment in found:
                raise InputError(name, value, f"within allows the {moment} an error already; leave one of them out")
            found[moment] = Allowed(positive(f"{name} of the {moment}", error), name == "within")
    missing = [m for m in moments if m not in found]
    if missing:
        raise InputError(
            "within", options.get("within"), f"allow {missing[0]!r} an error too, or leave it out of moments"
        )
    return {m: found[m] for m in moments}
