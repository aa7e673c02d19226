"""Names of the stationary quantities."""

from collections.abc import Iterator

from rattle.montecarlo.long_run.sums import ABOVE, FLIGHT, GROUPS, SPEED

QUANTILES = (1, 5, 50, 95, 99)
"""Percentages of the quantiles."""
NAMES = {ABOVE: "speed_above", FLIGHT: "flight", SPEED: "speed"}
"""Of what has a distribution, by its index there: the speed of impacts that are not slow, flight, and speed."""


def groups(stages: int) -> Iterator[tuple[int, str]]:
    """The groups of impacts of a scene with the suffixes of their names."""
    yield 0, ""
    for mesh in range(1, GROUPS if stages == 2 else 1):
        yield mesh, f"_mesh{mesh}"


def all_names(stages: int) -> tuple[str, ...]:
    """Names of all quantities, in the order of a table.

    Examples
    --------
    >>> all_names(1)[:4]
    ('rate_above', 'speed_above', 'sd_speed_above', 'skew_speed_above')
    """
    found = []
    spread = ("", "sd_", "skew_", *(f"q{percent:02d}_" for percent in QUANTILES))
    for _, suffix in groups(stages):
        for rate, names in (("rate_above", ("speed_above",)), ("rate", ("flight", "speed"))):
            found += [rate + suffix, *(f"{prefix}{name}{suffix}" for name in names for prefix in spread)]
        found += [name + suffix for name in ("energy", "energy_per_period", "power", "slow_share")]
    return (*found, *(f"contact_share_mesh{mesh}" for mesh in range(1, stages + 1)))
