"""The exceptions of the project; every message names the field, the value and the remedy."""

__all__ = ["FileError", "InputError", "OutputError", "RattleError"]


class RattleError(Exception):
    """Base of every error that this project raises on purpose."""


class InputError(RattleError, ValueError):
    """A value that the model or a run cannot take.

    Parameters
    ----------
    field : str
        Name of the offending field, as the caller spells it.
    value : object
        The value that was given.
    remedy : str
        What to change, as a sentence without its first capital.

    Examples
    --------
    >>> print(InputError("epsilon", 1.2, "give a restitution between 0 and 1"))
    epsilon = 1.2: give a restitution between 0 and 1
    """

    def __init__(self, field: str, value: object, remedy: str) -> None:
        super().__init__(f"{field} = {value!r}: {remedy}")
        self.field, self.value, self.remedy = field, value, remedy


class FileError(InputError):
    """A file that cannot be read, or whose content is not what it should be."""


class OutputError(RattleError, OSError):
    """An output folder that cannot be written without losing something."""
