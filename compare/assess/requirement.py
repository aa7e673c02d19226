"""A requirement on a quantity of the long run, ``rate_above < 50``, and whether it is met."""

import re
from enum import StrEnum
from typing import Any, NamedTuple

import pandas as pd

from rattle.montecarlo.long_run.estimates import check_quantity
from rattle.scene import InputError

REQUIREMENT = re.compile(r"\s*(\w+)\s*([<>])\s*(\S+)\s*")
WRITE = "write QUANTITY < NUMBER or QUANTITY > NUMBER, such as 'rate_above < 50'"


class Fulfilment(StrEnum):
    """Whether a requirement is met."""

    MET = "met"
    MISSED = "not met"
    OPEN = "not decided: the limit lies within the interval"
    UNKNOWN = "not decided: the quantity is not known"


class Requirement(NamedTuple):
    """A limit of a quantity, in the units of the answer."""

    quantity: str
    relation: str  # ``<`` or ``>``
    limit: float

    def __str__(self) -> str:
        return f"{self.quantity} {self.relation} {self.limit:g}"

    def decide(self, motion: pd.DataFrame) -> Fulfilment:
        """Decide by the 95 % interval of the quantity, from a table with index ``quantity``."""
        row: Any = motion.reindex([self.quantity]).iloc[0]
        low = float(row["low"])
        high = float(row["high"])
        if not low <= high:
            return Fulfilment.UNKNOWN
        if not (high < self.limit or low > self.limit):
            return Fulfilment.OPEN
        met = high < self.limit if self.relation == "<" else low > self.limit
        return Fulfilment.MET if met else Fulfilment.MISSED


def read_requirement(text: str, stages: int) -> Requirement:
    """Read a requirement as it is typed."""
    parts = REQUIREMENT.fullmatch(text)
    if parts is None:
        raise InputError("require", text, WRITE)
    quantity, relation, number = parts.groups()
    check_quantity("require", quantity, stages)
    try:
        limit = float(number)
    except ValueError:
        raise InputError("require", text, f"{number!r} is not a number; {WRITE}") from None
    return Requirement(quantity, relation, limit)
