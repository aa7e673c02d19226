"""What the user has chosen for a session, read from the text of the options."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from rattle.scene.errors import InputError
from rattle.scene.validate import choice, count, finite

if TYPE_CHECKING:
    from rattle.compare.thresholds.claim import Claim

__all__ = ["BASELINES", "PROFILES", "TIMES", "UNDECIDED", "Settings", "read_settings"]

PROFILES = {"quick": 32_768, "full": 1_048_576}
"""Simulated paths with which a test begins that does not say how many."""
TIMES = 8
"""Times as many paths as it begins with, up to which an undecided test is given more, unless a budget is stated."""
UNDECIDED = ("fail", "skip")
BASELINES = ("compare", "record", "regenerate")


class Settings(NamedTuple):
    """What the user has chosen for the session.

    ``false_alarm`` is the largest probability that it fails although every claim in it is true; ``budget`` the most
    paths that an undecided test is given, None for `TIMES` those it begins with; ``cache`` is None for pytest's own.
    """

    false_alarm: float = 0.01
    undecided: str = "fail"
    profile: str = "quick"
    budget: int | None = None
    cache: Path | None = None
    seed: int = 0
    workers: int = 1
    baselines: str = "compare"

    def sizes(self, claim: "Claim") -> tuple[int | None, ...]:
        """Numbers of paths at which a claim may be looked at: doubled up to its budget.

        They are fixed before anything is simulated, so the intervals of all looks can be made to hold at once.  With an
        accuracy there is one look, at as many paths as that takes: None.

        Examples
        --------
        >>> from rattle.compare.thresholds.claim import read_claim
        >>> from rattle.scene import DAT21, Scene
        >>> claim = read_claim({"scene": Scene.from_gears(DAT21, sigma=0.1), "paths": 10_000}, Path())
        >>> Settings().sizes(claim), Settings(budget=30_000).sizes(claim), Settings(budget=1).sizes(claim)
        ((10000, 20000, 40000, 80000), (10000, 20000, 30000), (10000,))
        """
        if claim.accuracy is not None:
            return (None,)
        first = claim.paths or PROFILES[self.profile]
        most = claim.budget or self.budget or TIMES * first
        sizes = [first]
        while sizes[-1] < most:
            sizes.append(min(2 * sizes[-1], most))
        return tuple(sizes)


def read_settings(chosen: Mapping[str, str]) -> Settings:
    """Settings from the text of the options.

    Raises
    ------
    InputError
        Names the option, its value and the remedy.

    Examples
    --------
    >>> read_settings({"rattle_false_alarm": "0.05", "rattle_cache": ""}).false_alarm
    0.05
    """
    given = {name.removeprefix("rattle_"): text for name, text in chosen.items() if text != ""}
    rate = _number("rattle-false-alarm", given.pop("false_alarm", "0.01"))
    if not 0.0 < finite("rattle-false-alarm", rate) < 1.0:
        raise InputError("rattle-false-alarm", rate, "must lie between 0 and 1, both excluded")
    return Settings(
        rate,
        choice("rattle-undecided", given.get("undecided", "fail"), UNDECIDED),
        choice("rattle-profile", given.get("profile", "quick"), PROFILES),
        count("rattle-budget", _whole("rattle-budget", given["budget"])) if "budget" in given else None,
        Path(given["cache"]) if "cache" in given else None,
        count("rattle-seed", _whole("rattle-seed", given.get("seed", "0")), least=0),
        count("rattle-workers", _whole("rattle-workers", given.get("workers", "1"))),
        choice("rattle-baselines", given.get("baselines", "compare"), BASELINES),
    )


def _number(field: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(field, text, "give a number") from None


def _whole(field: str, text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise InputError(field, text, "give a whole number") from None
