"""Text files that people write: read as data only, with errors that name the file."""

import tomllib
from pathlib import Path
from typing import Any

from rattle.scene.errors import FileError

__all__ = ["read_text", "read_toml"]


def read_text(what: str, path: str | Path) -> str:
    """The text of a file.

    Raises
    ------
    FileError
        Names what the file was to be, its path, and the remedy.
    """
    try:
        return Path(path).read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise FileError(what, str(path), "is not UTF-8 text; give a TOML file") from None
    except OSError as error:
        raise FileError(what, str(path), f"cannot be read ({error.strerror}); give a TOML file") from None
    except (TypeError, ValueError):  # no path at all, or one with a null character in it
        raise FileError(what, path, "is no path; give that of a TOML file") from None


def read_toml(text: str) -> dict[str, Any]:
    """The data of a TOML text.

    Examples
    --------
    >>> read_toml("sigma = 0.1")
    {'sigma': 0.1}
    """
    if not isinstance(text, str):
        raise FileError("TOML", text, "give text")
    try:
        return tomllib.loads(text)
    except ValueError as error:  # a number of thousands of digits raises one that is not of TOML
        raise FileError("TOML", str(error), "correct the file at that place") from None
    except RecursionError:
        raise FileError("TOML", text[:20], "is nested too deeply; give a file that people write") from None
