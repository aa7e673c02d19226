"""Reading of text and TOML files, with errors that name the file."""

import tomllib
from pathlib import Path
from typing import Any

from rattle.scene.errors import FileError

__all__ = ["read_text", "read_toml"]


def read_text(what: str, path: str | Path) -> str:
    """Read a UTF-8 text file.

    Parameters
    ----------
    what : str
        What the file is, for error messages, such as ``"scene file"``.
    path : str or Path
        Where it is.

    Returns
    -------
    str
        Its content.

    Raises
    ------
    FileError
        If it cannot be read or is not UTF-8; names what the file was to be, its path, and the remedy.
    """
    try:
        return Path(path).read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise FileError(what, str(path), "is not UTF-8 text; give a TOML file") from None
    except OSError as error:
        raise FileError(what, str(path), f"cannot be read ({error.strerror}); give a TOML file") from None
    except (TypeError, ValueError):  # not a path, or one with a null character in it
        raise FileError(what, path, "is no path; give that of a TOML file") from None


def read_toml(text: str) -> dict[str, Any]:
    """Parse a TOML text.

    Parameters
    ----------
    text : str
        Content of a TOML file.

    Returns
    -------
    dict
        Its data.

    Raises
    ------
    FileError
        If it is no text, no valid TOML, or nested too deeply.

    Examples
    --------
    >>> read_toml("sigma = 0.1")
    {'sigma': 0.1}
    """
    if not isinstance(text, str):
        raise FileError("TOML", text, "give text")
    try:
        return tomllib.loads(text)
    except ValueError as error:  # includes TOMLDecodeError; an integer of too many digits raises a plain ValueError
        raise FileError("TOML", str(error), "correct the file at that place") from None
    except RecursionError:
        raise FileError("TOML", text[:20], "is nested too deeply; give a file that people write") from None
