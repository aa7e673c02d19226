"""The settings of a session, read from the text of the options."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from rattle.scene.errors import InputError
from rattle.scene.validate import choice, count, finite

PROFILES = {"quick": 32_768, "full": 1_048_576}
"""Simulated paths of the first look, unless the marker gives a number."""
TIMES = 8
"""Default budget of an undecided test, as a multiple of the paths of its first look."""
UNDECIDED = ("fail", "skip")
BASELINES = ("compare", "record", "regenerate")


class Settings(NamedTuple):
    """Settings of a session."""

    false_alarm: float = 0.01  # largest probability that a test fails although its claim is true
    undecided: str = "fail"  # outcome of a test that its budget does not decide, ``fail`` or ``skip``
    profile: str = "quick"  # key of `PROFILES`
    budget: int | None = None  # largest number of paths of an undecided test; None for `TIMES` those of its first look
    cache: Path | None = None  # folder of the simulations; None for pytest's own cache
    seed: int = 0  # seed, workers: seed and threads of the simulations
    workers: int = 1
    baselines: str = "compare"  # ``compare``, ``record`` or ``regenerate``

    def sizes(self, first: int | None, most: int | None) -> tuple[int, ...]:
        """Numbers of paths of all possible looks at a claim: from its first one doubled up to its budget.

        They are fixed before anything is simulated, so that the intervals of all looks can have simultaneous coverage.

        Examples
        --------
        >>> Settings().sizes(10_000, None), Settings(budget=30_000).sizes(10_000, None), Settings().sizes(10_000, 1)
        ((10000, 20000, 40000, 80000), (10000, 20000, 30000), (10000,))
        """
        sizes = [first or PROFILES[self.profile]]
        most = most or self.budget or TIMES * sizes[0]
        while sizes[-1] < most:
            sizes.append(min(2 * sizes[-1], most))
        return tuple(sizes)


def read_settings(chosen: Mapping[str, str]) -> Settings:
    """Read settings from the text of the options.

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
