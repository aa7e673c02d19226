"""A test's claim about the accuracy of a closure, and the settings of a session, validated before
any simulation."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

from rattle.compare.judge.verdict import Tolerances
from rattle.compare.study.cells import Sample, check_sample
from rattle.compare.validation.errors import ON_ITINERARY
from rattle.montecarlo.looks import ladder
from rattle.montecarlo.settings import MOST_PATHS
from rattle.scene import (
    FileError,
    InputError,
    Scene,
    check_keys,
    choice,
    count,
    finite,
    positive,
    section_names,
    state_names,
)
from rattle.scene.text import show

PROFILES = {"quick": 32_768, "full": 1_048_576}
"""Simulated paths of the first look, unless the marker gives a number."""
BUDGET_FACTOR = 8
"""Default budget of an undecided test, as a multiple of the paths of its first look."""
UNDECIDED_CHOICES = ("fail", "skip")
BASELINES = ("compare", "record", "regenerate")


class Settings(NamedTuple):
    """Settings of a session."""

    false_alarm: float = 0.01  # largest probability that a test fails although its claim is true
    # outcome of a test that its budget does not decide, ``fail`` or ``skip``
    undecided: str = "fail"
    profile: str = "quick"  # key of `PROFILES`
    # largest number of paths of an undecided test; None for `BUDGET_FACTOR` those of its first look
    budget: int | None = None
    cache: Path | None = None  # folder of the simulations; None for pytest's own cache
    seed: int = 0  # seed, workers: seed and threads of the simulations
    workers: int = 1
    baselines: str = "compare"  # ``compare``, ``record`` or ``regenerate``

    def sizes(self, first: int | None, most: int | None) -> tuple[int, ...]:
        """Numbers of paths of all possible looks at a claim: from its first one doubled up to its
        budget.

        They are fixed before anything is simulated, so that the intervals of all looks can have
        simultaneous coverage.
        """
        first = first or PROFILES[self.profile]
        return ladder(first, most or self.budget or BUDGET_FACTOR * first)


def read_settings(chosen: Mapping[str, str]) -> Settings:
    """Read settings from the text of the options."""
    text = {key.removeprefix("rattle_"): given for key, given in chosen.items()}
    rate = _parse("rattle-false-alarm", text["false_alarm"], float)
    if not 0.0 < finite("rattle-false-alarm", rate) < 1.0:
        raise InputError("rattle-false-alarm", rate, "must lie between 0 and 1, both excluded")
    return Settings(
        rate,
        choice("rattle-undecided", text["undecided"], UNDECIDED_CHOICES),
        choice("rattle-profile", text["profile"], PROFILES),
        _parse_count("rattle-budget", text["budget"]) if text["budget"] else None,
        Path(text["cache"]) if text["cache"] else None,
        _parse_count("rattle-seed", text["seed"], least=0),
        _parse_count("rattle-workers", text["workers"]),
        choice("rattle-baselines", text["baselines"], BASELINES),
    )


def _parse(field: str, text: str, kind: type) -> Any:
    try:
        return kind(text)
    except ValueError:
        raise InputError(field, text, f"give a{' whole' if kind is int else ''} number") from None


def _parse_count(field: str, text: str, least: int = 1) -> int:
    return count(field, _parse(field, text, int), least)


CLAIMED_MOMENTS = ("mean", "sd")
CLAIM_KINDS = ("section", ON_ITINERARY)
CLAIM_OPTIONS = (
    *("scene", "impacts", "kind", "quantities", "moments", "within", "absolute"),  # what is claimed
    *("paths", "budget", "accuracy", "scheme", "undecided"),  # how it is decided
)
RIVALS = ({"within", "absolute"}, {"paths", "accuracy"}, {"budget", "accuracy"})
"""Sets of mutually exclusive options."""
FEWEST_CLAIM_PATHS = 1024
"""Smallest admissible number of paths, for reliable standard errors of sds."""


class ClaimRow(NamedTuple):
    """One check: a moment (``mean`` or ``sd``) of a quantity at an impact."""

    moment: str
    quantity: str
    impact: int

    @property
    def column(self) -> str:
        """Name of its column in a section table."""
        return self.quantity if self.moment == "mean" else f"sd_{self.quantity}"


class Allowed(NamedTuple):
    """Largest admissible error."""

    error: float
    in_sd: bool  # whether `error` is in sds of the quantity; absolute otherwise


@dataclass(frozen=True)
class Claim:
    """The claim that section moments of a closure are right within a tolerance."""

    scene: Scene
    impacts: tuple[int, ...]  # impacts that are checked, ascending
    quantities: tuple[str, ...]  # names in `rattle.scene.section_names`
    allowed: Mapping[str, Allowed]  # for each moment, ``mean`` or ``sd``
    # simulated paths to begin with; None for those of the session's profile
    paths: int | None = None
    # largest number of paths while the claim is undecided; None for the session's
    budget: int | None = None
    # accuracy to simulate to instead of a number of paths, see `montecarlo.simulate`
    accuracy: float | None = None
    scheme: str = "exact-flight"  # scheme of the simulation
    # outcome of the test if its budget does not decide it, ``fail`` or ``skip``; None for the
    # session's
    undecided: str | None = None
    # about all paths, or those alone that have followed the closure's itinerary
    kind: str = CLAIM_KINDS[0]

    @cached_property
    def rows(self) -> tuple[ClaimRow, ...]:
        """All checks of the claim."""
        return tuple(map(ClaimRow._make, product(self.allowed, self.quantities, self.impacts)))

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns of a section table that a model has to predict."""
        return tuple(dict.fromkeys(row.column for row in self.rows))


def read_markers(markers: Iterable[Any], folder: Path) -> Claim:
    """Read a claim from the markers of a test, its class and its module, see `read_claim`."""
    merged: dict[str, Any] = {}
    for mark in reversed(list(markers)):  # those of class and module follow that of the test
        if mark.args:
            why = "name every option, as in scene='dat21.toml'"
            raise InputError("marker rattle", mark.args, why)
        replaced = {name for rivals in RIVALS if rivals & mark.kwargs.keys() for name in rivals}
        merged = {name: merged[name] for name in merged.keys() - replaced} | mark.kwargs
    return read_claim(merged, folder)


def read_claim(options: Mapping[str, Any], folder: Path) -> Claim:
    """Read a claim from the options of a marker; `folder` is that of the test, to which a scene
    file is relative."""
    check_keys("option of the marker rattle", options, CLAIM_OPTIONS)
    scene = _scene(options.get("scene"), folder)
    valid = section_names(scene.stages)
    # these vary at every impact, unlike a displacement, which is fixed at the mesh that is struck
    varying = ("tau", *state_names(scene.stages)[1::2])
    quantities = _names("quantities", options.get("quantities", varying), valid)
    moments = _names("moments", options.get("moments", CLAIMED_MOMENTS), CLAIMED_MOMENTS)
    impacts = _impacts(options.get("impacts", 4))
    paths, budget, accuracy = (options.get(name) for name in ("paths", "budget", "accuracy"))
    for name, value, least in (("paths", paths, FEWEST_CLAIM_PATHS), ("budget", budget, 1)):
        if value is not None and accuracy is not None:
            why = f"chooses the number of paths itself; leave out {name} = {show(value)}"
            raise InputError("accuracy", accuracy, why)
        if value is not None:
            count(name, value, least, MOST_PATHS)
    if (undecided := options.get("undecided")) is not None:
        choice("undecided", undecided, UNDECIDED_CHOICES)
    scheme = options.get("scheme", "exact-flight")
    kind = choice("kind", options.get("kind", CLAIM_KINDS[0]), CLAIM_KINDS)
    check_sample(Sample(scene, impacts[-1], 0, scheme, paths, accuracy))
    allowed = _read_tolerances(options, moments)
    return Claim(
        scene, impacts, quantities, allowed, paths, budget, accuracy, scheme, undecided, kind
    )


def _scene(given: object, folder: Path) -> Scene:
    if isinstance(given, Scene):
        return given
    if not isinstance(given, str | Path):
        raise InputError("scene", given, "give a Scene, or the name of a TOML file beside the test")
    path = folder / given
    if not path.is_file():
        why = f"there is no file {path}; give the name of a file, relative to the test"
        raise FileError("scene", str(given), why)
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
    impacts = {count("impacts", impact) for impact in given}
    if not impacts:
        raise InputError("impacts", given, "give their number, or a list such as range(1, 5)")
    return tuple(sorted(impacts))


def _read_tolerances(options: Mapping[str, Any], moments: tuple[str, ...]) -> dict[str, Allowed]:
    """The admissible error of each moment; by default the standard tolerances of accurate
    verdicts."""
    allowed: dict[str, Allowed] = {}
    given = {
        name: options[name] for name in ("within", "absolute") if options.get(name) is not None
    }
    if not given:
        standard = Tolerances()._asdict()
        given["within"] = {moment: standard[moment] for moment in moments}
    for name, value in given.items():
        errors = value if isinstance(value, Mapping) else dict.fromkeys(moments, value)
        for moment, error in errors.items():
            if choice(f"moment of {name}", moment, CLAIMED_MOMENTS) not in moments:
                why = f"{moment!r} is not among moments = {moments!r}; add it, or leave it out"
                raise InputError(name, value, why)
            if moment in allowed:
                why = f"within has a tolerance for the {moment} already; leave one of them out"
                raise InputError(name, value, why)
            allowed[moment] = Allowed(positive(f"{name} of the {moment}", error), name == "within")
    if missing := [moment for moment in moments if moment not in allowed]:
        why = f"give {missing[0]!r} a tolerance too, or leave it out of moments"
        raise InputError("within", options.get("within"), why)
    return {moment: allowed[moment] for moment in moments}
