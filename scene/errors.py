"""The exceptions of the project; every message names the field, the value and the remedy."""

from rattle.scene.text import harmless

__all__ = ["FileError", "InputError", "OutputError", "RattleError"]

LONGEST = 300  # most characters of a value that a message quotes


class RattleError(Exception):
    """Base of every error that this project raises on purpose; control characters in its message are escaped."""

    def __init__(self, message: str) -> None:
        super().__init__(harmless(message))


class InputError(RattleError, ValueError):
    """An input value that is not admissible.

    Parameters
    ----------
    field : str
        Name of the offending field, as the caller spells it.
    value : object
        The value that was given.
    remedy : str
        What to change, as a sentence without its first capital.
    where : str, optional
        The file that holds it, and the line if it is known.

    Examples
    --------
    >>> print(InputError("epsilon", 1.2, "give a restitution between 0 and 1"))
    epsilon = 1.2: give a restitution between 0 and 1
    """

    def __init__(self, field: str, value: object, remedy: str, where: str = "") -> None:
        super().__init__(harmless(f"{where}{': ' * bool(where)}{field} = {_show(value)}: {remedy}", keep=""))
        self.field, self.value, self.remedy, self.where = field, value, remedy, where

    def __reduce__(self) -> tuple[type["InputError"], tuple[str, object, str, str]]:
        return type(self), (self.field, self.value, self.remedy, self.where)  # for worker processes


def _show(value: object) -> str:
    """A value as it was given, cut to `LONGEST` characters; Python prints no integer of more than 4300 digits."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):
        return f"<{type(value).__name__}>"
    return text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."


class FileError(InputError):
    """An input file that cannot be read, or whose content is not valid."""


class OutputError(RattleError, OSError):
    """An output folder that cannot be written, or only by overwriting something."""
