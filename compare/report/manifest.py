"""The manifest of a report: all that is needed to repeat a run bit for bit, and to check that it was."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from rattle.compare.report.json_text import json_digest, plain
from rattle.scene.errors import FileError, InputError
from rattle.scene.files import read_json
from rattle.scene.scene import Scene
from rattle.scene.validate import check_keys

VERSION = 1
"""Version of the format of manifests."""

DIGESTS = ("table_sha256", "validity_sha256")
"""Digests that a repeated run must share with the first; timings are not covered."""


class ReportSettings(NamedTuple):
    """The settings of a report; together with the versions they determine every number."""

    name: str  # of the scene
    scenes: tuple[Scene, ...]  # one for each noise intensity
    impacts: int  # impacts, paths, dt, scheme, seed: of the simulations, see `rattle.montecarlo.simulate`
    paths: int
    dt: float
    scheme: str
    seed: int
    order: int  # order of the closures' moments
    closures: tuple[str, ...]
    validity: tuple[float, ...] = ()  # noise intensities of the range of validity; may be empty
    validity_paths: int = 0  # simulated paths at each of these
    beside: tuple[str, ...] = ()  # schemes whose ensembles are shown beside that of the report

    @property
    def simulation(self) -> dict[str, Any]:
        """Settings of every simulation of the report, except scene and threads."""
        return {name: getattr(self, name) for name in ("paths", "impacts", "dt", "scheme")} | {"rng": self.seed}

    @property
    def sweep(self) -> dict[str, Any]:
        """Settings of the simulations for the range of validity."""
        return {"paths": self.validity_paths, "impacts": self.impacts, "rng": self.seed}

    def to_dict(self) -> dict[str, Any]:
        """The settings as plain data for the manifest."""
        return {**self._asdict(), "scenes": [s.to_dict() for s in self.scenes]}


class Recorded(NamedTuple):
    """Content of the manifest of an earlier report."""

    settings: ReportSettings
    digests: dict[str, str | None]  # of its tables, by `DIGESTS`; None where it has no such table
    # see `versions`; entries that an earlier version of this program did not record are missing
    versions: dict[str, str]


def read_settings(path: Path) -> Recorded:
    """Read the manifest of an earlier report."""
    try:
        data = read_json("manifest", path, "a manifest.json")
        not_newer(data, path)
        if not is_whole(data):
            raise FileError("manifest", str(path), "was changed after it was written; restore it")
        settings = data["settings"]
        if not isinstance(settings["name"], str):
            raise TypeError("its name is no text")
        check_keys("manifest.settings", settings, ReportSettings._fields)
        scenes = tuple(Scene.from_dict(s) for s in settings["scenes"])
        if not scenes:
            raise InputError("manifest.settings.scenes", [], "must hold a scene")
        lists = {"closures": tuple(settings["closures"]), "validity": tuple(settings.get("validity", ()))}
        lists["beside"] = tuple(settings.get("beside", ()))
        digests = {name: data.get(name) for name in DIGESTS}
        if digests["table_sha256"] is None:
            raise KeyError("table_sha256")
        name = settings["name"].encode(errors="replace").decode()
        versions = {str(of): str(version) for of, version in data.get("versions", {}).items()}
        return Recorded(ReportSettings(**{**settings, "name": name, "scenes": scenes, **lists}), digests, versions)
    except InputError:
        raise
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise FileError("manifest", str(path), f"is no manifest of this version ({error})") from None


def not_newer(data: dict[str, Any], path: Path) -> None:
    """Check that a manifest was not written by a newer version of this program."""
    version = data.get("version", 1)
    if type(version) is int and version > VERSION:
        why = f"comes from a newer version of rattle (manifest {version}; this one reads {VERSION}); update rattle"
        raise FileError("manifest", str(path), why)


def seal(record: Mapping[str, Any]) -> dict[str, Any]:
    """Add a digest of a record to it, so that a later change is detected.

    Examples
    --------
    >>> is_whole(seal({"z": 4.1})), is_whole(seal({"z": 4.1}) | {"z": 1.4})
    (True, False)
    """
    record = plain(record)
    return {**record, "seal": json_digest(record)}


def is_whole(record: Mapping[str, Any]) -> bool:
    """Whether a record is unchanged since it was sealed."""
    content = {name: value for name, value in record.items() if name != "seal"}
    return "seal" not in record or record["seal"] == json_digest(content)


def digest(text: str) -> str:
    """SHA-256 digest of a text."""
    return hashlib.sha256(text.encode()).hexdigest()
