"""Where a report comes from: everything that a run needs to be repeated bit for bit, and to see whether it was."""

import hashlib
import importlib.metadata
import json
import platform
import re
import shlex
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numba
from llvmlite import binding

from rattle.compare.report.json_text import json_digest, plain
from rattle.scene.errors import FileError, InputError
from rattle.scene.scene import Scene
from rattle.scene.validate import known_keys

__all__ = [
    "DIGESTS",
    "VERSION",
    "Recorded",
    "Settings",
    "command_line",
    "commit",
    "digest",
    "is_whole",
    "not_newer",
    "read_settings",
    "sealed",
    "versions",
]

COMPILER: Any = numba.config  # it has no types

VERSION = 1
"""Of a manifest: what has another form is written with a greater one."""

PACKAGES = ("rattle", "numpy", "numba", "llvmlite", "scipy", "pandas", "matplotlib", "pyarrow")

DIGESTS = ("table_sha256", "validity_sha256")
"""What a repeated run must have in common with the first; timings are no part of it."""


class Settings(NamedTuple):
    """What a report was asked for; with the scenes and the versions it fixes every number."""

    name: str
    scenes: tuple[Scene, ...]
    impacts: int
    paths: int
    dt: float
    scheme: str
    seed: int
    order: int
    closures: tuple[str, ...]
    validity: tuple[float, ...] = ()
    validity_paths: int = 0

    @property
    def simulation(self) -> dict[str, Any]:
        """What every simulation of the report is asked for, but for the scene and the threads."""
        return {name: getattr(self, name) for name in ("paths", "impacts", "dt", "scheme")} | {"rng": self.seed}

    @property
    def sweep(self) -> dict[str, Any]:
        """What the simulations of the range of validity are asked for."""
        return {"paths": self.validity_paths, "impacts": self.impacts, "rng": self.seed}

    def to_dict(self) -> dict[str, Any]:
        """Plain data for the manifest."""
        return {**self._asdict(), "scenes": [s.to_dict() for s in self.scenes]}


class Recorded(NamedTuple):
    """What a manifest says of an earlier report.

    Attributes
    ----------
    settings : Settings
    digests : dict of str to str
        Of its tables, by `DIGESTS`; None where it has no such table.
    versions : dict of str to str
        As `versions` gives them; what an earlier version of this program did not record is missing.
    """

    settings: Settings
    digests: dict[str, str | None]
    versions: dict[str, str]


def read_settings(path: Path) -> Recorded:
    """What an earlier report was asked for, the digests of its tables and the versions, from its manifest.

    Raises
    ------
    FileError
        If the file cannot be read or is no manifest.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        not_newer(data, path)
        if not is_whole(data):
            raise FileError("manifest", str(path), "was changed after it was written; restore it")
        settings = data["settings"]
        if not isinstance(settings["name"], str):
            raise TypeError("its name is no text")
        known_keys("manifest.settings", settings, Settings._fields)
        scenes = tuple(Scene.from_dict(s) for s in settings["scenes"])
        if not scenes:
            raise InputError("manifest.settings.scenes", [], "must hold a scene")
        lists = {"closures": tuple(settings["closures"]), "validity": tuple(settings.get("validity", ()))}
        digests = {name: data.get(name) for name in DIGESTS}
        if digests["table_sha256"] is None:
            raise KeyError("table_sha256")
        name = settings["name"].encode(errors="replace").decode()
        versions = {str(of): str(version) for of, version in data.get("versions", {}).items()}
        return Recorded(Settings(**{**settings, "name": name, "scenes": scenes, **lists}), digests, versions)
    except OSError as error:
        raise FileError("manifest", str(path), f"cannot be read ({error.strerror})") from None
    except InputError:
        raise
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise FileError("manifest", str(path), f"is no manifest of this version ({error})") from None


def not_newer(data: dict[str, Any], path: Path) -> None:
    """Refuse the data of a manifest that a newer version of this program has written.

    Raises
    ------
    FileError
        Says which version it has, and to update.
    """
    version = data.get("version", 1)
    if type(version) is int and version > VERSION:
        why = f"comes from a newer version of rattle (manifest {version}; this one reads {VERSION}); update rattle"
        raise FileError("manifest", str(path), why)


def command_line(words: Sequence[str]) -> str:
    """A command as it is typed, in characters that any file can hold.

    Examples
    --------
    >>> command_line(["show", "my report"])
    "rattle show 'my report'"
    """
    return shlex.join(["rattle", *words]).encode(errors="backslashreplace").decode()


def sealed(record: Mapping[str, Any]) -> dict[str, Any]:
    """A record with a digest of all the rest of it, so that a change is seen when it is read back.

    Examples
    --------
    >>> is_whole(sealed({"z": 4.1})), is_whole(sealed({"z": 4.1}) | {"z": 1.4})
    (True, False)
    """
    record = plain(record)
    return {**record, "seal": json_digest(record)}


def is_whole(record: Mapping[str, Any]) -> bool:
    """Whether a record that was read back is as it was sealed; one of an earlier version has no seal."""
    rest = {name: value for name, value in record.items() if name != "seal"}
    return "seal" not in record or record["seal"] == json_digest(rest)


def versions() -> dict[str, str]:
    """Versions of what the numbers depend on, and the processor: its model, and what the compiler makes of it."""
    found = {
        "python": platform.python_version(), "machine": platform.machine(), "processor": _processor(),
        "compiled for": COMPILER.CPU_NAME or binding.get_host_cpu_name(), "vectors": _vectors(),
    }  # fmt: skip
    for package in PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found


def _processor() -> str:
    """The model of the processor as the system names it."""
    try:
        found = re.search(r"^model name\s*:\s*(.+)$", Path("/proc/cpuinfo").read_text(errors="replace"), re.MULTILINE)
    except OSError:
        found = None
    return found[1] if found else platform.processor() or "unknown"


def _vectors() -> str:
    """The vector instructions for which code is compiled: they decide the order of sums, and so their last bits."""
    chosen = COMPILER.CPU_FEATURES
    features = binding.get_host_cpu_features().flatten() if chosen is None else chosen
    return " ".join(sorted(re.findall(r"\+(s?sse[\w.]*|avx[\w.]*|fma\w*|neon|sve\w*)", features))) or "none"


def commit() -> str:
    """Commit of the code that runs, with ``+changes`` if it differs from it; ``unknown`` outside a repository."""
    here = Path(__file__).resolve().parents[2]

    def git(*words: str) -> str:
        return subprocess.run(
            ["git", "-C", str(here), *words], capture_output=True, text=True, check=True
        ).stdout.strip()

    try:
        if Path(git("rev-parse", "--show-toplevel")).resolve() != here:
            return "unknown"
        changed = git("status", "--porcelain", "--", "scene", "closure", "montecarlo", "compare")
        return git("rev-parse", "HEAD") + ("+changes" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def digest(text: str) -> str:
    """SHA-256 of a text."""
    return hashlib.sha256(text.encode()).hexdigest()
