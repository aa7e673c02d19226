"""Checks of invalid input: it must lead to one of our errors that names it, never to an error of another library."""

import json
import os
import tempfile
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from click.testing import CliRunner, Result
from fuzz_bad import STUDY
from fuzz_must import finite
from settings import recorded

from rattle.closure import mean_map
from rattle.compare import validate
from rattle.compare.cli.main import main
from rattle.compare.report import manifest
from rattle.compare.report.json_text import read_page
from rattle.compare.study.design import Study
from rattle.compare.study.folder import is_current, load_study
from rattle.compare.study.store import Store
from rattle.compare.thresholds.fixture import read_baseline
from rattle.montecarlo import AccuracyWarning, simulate, simulate_to
from rattle.scene import DAT21, Scene
from rattle.scene.errors import InputError, RattleError

__all__ = ["command", "file", "ran", "refused", "setting", "spoilt", "text"]

Ended = tuple[str, str]
DAT = Scene.from_gears(DAT21, sigma=0.1)
TINY = {"paths": 32, "impacts": 1}


def refused(error: RattleError, name: str) -> Ended:
    """An error of ours that names what it is about."""
    if not str(error) or name not in str(error):
        raise AssertionError(f"{error!r} does not name {name!r}")
    if len(str(error)) > 2000:
        raise AssertionError(f"a message of {len(str(error))} characters")
    return "refused", getattr(error, "field", type(error).__name__)


def spoilt(data: dict[str, Any], name: str) -> Ended:
    """A scene with something bad in it is refused by name, or is a scene all the same."""
    try:
        scene = Scene.from_dict(data)
    except InputError as error:
        return refused(error, name if error.field not in ("scene", "gears") else "")
    if Scene.from_toml(scene.to_toml()) != scene or not finite(scene):
        raise AssertionError(f"accepted, but not a valid scene: {scene}")
    return "complete", ""


@cache
def _map() -> Any:
    return mean_map(DAT, impacts=2)


def _to_accuracy(**settings: Any) -> Any:
    """An accuracy that two seconds do not reach is said by a warning, which is no defect."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AccuracyWarning)
        return simulate_to(DAT, **({"accuracy": 0.5, "impacts": 1, "budget": 2.0} | settings)).section


CALLS: dict[str, Callable[..., Any]] = {
    "mean_map": lambda **k: mean_map(DAT, **({"impacts": 1} | k)).section,
    "simulate": lambda **k: simulate(DAT, **recorded(TINY | {"horizon": 5.0} | k)).section,
    "simulate_to": _to_accuracy,
    "validate": lambda **k: validate(DAT, **({"impacts": 1, "paths": 64, "closures": ["corrected"]} | k)).table,
    "with_sigma": lambda sigma: DAT.with_sigma(sigma),
    "from_toml": lambda text: Scene.from_toml(text),
    "load": lambda path: Scene.load(path),
    "from_dict": lambda data: Scene.from_dict(data),
    "study": lambda path: Study.load(path),
    "study_text": lambda text: Study.from_toml(text),
    "tables": lambda path: load_study(path),
    "at_times": lambda times: _map().at_times(times),
    "density": lambda **k: _map().density(**({"impact": 1, "quantity": "y1", "values": np.array([0.0])} | k)),
    "edgeworth": lambda **k: _map().edgeworth(**({"impact": 1, "stage": 1} | k)),
}


def setting(function: str, keyword: str, value: Any) -> Ended:
    """A bad value of one setting of a public function."""
    try:
        CALLS[function](**{keyword: value})
    except RattleError as error:
        return refused(error, "" if keyword in ("text", "path", "data") else keyword.rstrip("s"))
    return "complete", ""


def text(kind: str, content: str) -> Ended:
    """A spoilt scene file, study file, manifest, page or baseline, as text."""
    path = _folder() / f"spoilt-{os.getpid()}"
    try:
        if kind == "scene":
            Scene.from_toml(content).to_toml()
        elif kind == "study":
            study = Study.from_toml(content)
            _ = study.cells if len(study.points) < 50 else ()
        else:
            path.write_text(content, encoding="utf-8")
            {"manifest": manifest.read_settings, "page": read_page, "baseline": read_baseline}[kind](path)
    except RattleError as error:
        return refused(error, "")
    return "complete", ""


@cache
def _folder() -> Path:
    """A folder with scene and study files, a finished study, and a page; made once in a process."""
    place = Path(tempfile.mkdtemp(prefix="rattle-fuzz-"))
    (place / "scene.toml").write_text(DAT.to_toml(), encoding="utf-8")
    (place / "bad.toml").write_text("[scene]\nalpha = 'x'\n", encoding="utf-8")
    (place / "study.toml").write_text(STUDY, encoding="utf-8")
    CliRunner().invoke(main, ["study", str(place / "study.toml"), "--workers", "1"], catch_exceptions=False)
    small = ["--paths", "64", "--impacts", "1", "--sigma", "0.1", "--no-validity", "--workers", "1"]
    CliRunner().invoke(main, ["validate", *small, "--out", str(place / "report")], catch_exceptions=False)
    (place / "baseline.toml").write_text("[values.y1]\n1 = 0.5\n\n" + DAT.to_toml(), encoding="utf-8")
    return place


def content(kind: str) -> str:
    """The text of a file of that kind as it is written."""
    place = _folder()
    files = {"scene": "scene.toml", "study": "study.toml"}
    files |= {"manifest": "report/manifest.json", "page": "report/page.json"}
    return (place / files.get(kind, "baseline.toml")).read_text(encoding="utf-8")


def command(words: list[str]) -> Ended:
    """A command line ends with an exit code of ours, and says what is wrong where it does nothing."""
    place = _folder()
    done = ran([word.replace("{tmp}", str(place)) for word in words], Path(tempfile.mkdtemp(dir=place)))
    return "refused" if done.exit_code == 2 else "complete", words[0]


def ran(words: list[str], folder: Path) -> Result:
    """A command line that has ended, begun in a folder: a report without --out goes below it."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        done = CliRunner().invoke(main, words)
    finally:
        os.chdir(before)
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    if done.exit_code == 2:
        said = done.stderr.strip()
        if not ("rattle: " in said or "Error: " in said or "Usage: " in said) or "Traceback" in done.output:
            raise AssertionError(f"exit code 2 without a reason: {done.output!r} {said!r}")
    elif done.exit_code not in (0, 1, 3, 4):
        raise AssertionError(f"exit code {done.exit_code}: {done.output}")
    return done


def mutated(data: bytes, how: list[tuple[str, float, int]]) -> bytes:
    """Bytes with bits flipped, cut off, overwritten, inserted or removed."""
    out = bytearray(data)
    for what, where, value in how:
        at = min(int(where * len(out)), max(len(out) - 1, 0))
        if what == "flip" and out:
            out[at] ^= 1 << (value % 8)
        elif what == "cut":
            del out[at:]
        elif what == "write":
            out[at : at + 4] = bytes([value]) * 4
        elif what == "insert":
            out[at:at] = bytes([value])
        elif what == "remove":
            del out[at : at + 1 + value % 16]
    return bytes(out)


def file(kind: str, how: list[tuple[str, float, int]]) -> Ended:
    """A spoilt result file is refused, or gives what was written: numbers never change in silence."""
    place = _folder()
    return FILES[kind](place, how)


def _cell(place: Path, how: list[tuple[str, float, int]]) -> Ended:
    study = Study.load(place / "study.toml")
    folder = place / "study" / "cells"
    cell = study.cells[int(how[0][1] * 1e6) % len(study.cells)]
    good = Store(folder)
    truth = good.read(cell)
    assert truth is not None
    with tempfile.TemporaryDirectory(dir=place) as scratch:
        store = Store(Path(scratch))
        store.path(cell).write_bytes(mutated(good.path(cell).read_bytes(), how))
        found = store.read(cell)
        if found is None:
            assert list(store.aside.glob("*.txt")), "set aside without a word"
            return "refused", "cell"
        pd.testing.assert_frame_equal(found.section, truth.section, check_exact=True)
        if found.facts != truth.facts:
            raise AssertionError(f"{found.facts} for {truth.facts}")
    return "complete", "cell"


def _tables(place: Path, how: list[tuple[str, float, int]]) -> Ended:
    truth = load_study(place / "study")
    names = [*(f"{n}.parquet" for n in ("errors", "sections", "validity", "cost")), "manifest.json", "study.toml"]
    path = place / "study" / names[how[0][2] % len(names)]
    kept = path.read_bytes()
    try:
        path.write_bytes(mutated(kept, how))
        found = load_study(place / "study")
        for name in ("errors", "sections", "validity", "cost"):
            pd.testing.assert_frame_equal(getattr(found, name), getattr(truth, name), check_exact=True)
        if found.record != truth.record or found.study.points != truth.study.points:
            raise AssertionError(f"{path.name} is not what was written")
        record = is_current(truth.study, place / "study")
        if record not in (None, truth.record):
            raise AssertionError("a changed manifest is taken for current")
    except RattleError as error:
        return refused(error, "")
    finally:
        path.write_bytes(kept)
    return "complete", path.suffix


def _json(name: str, read: Callable[[Path], Any]) -> Callable[[Path, list[tuple[str, float, int]]], Ended]:
    def check(place: Path, how: list[tuple[str, float, int]]) -> Ended:
        path = place / "report" / name
        truth, scratch = read(path), place / f"spoilt-{name}"
        scratch.write_bytes(mutated(path.read_bytes(), how))
        try:
            found = read(scratch)
        except RattleError as error:
            return refused(error, "")
        if json.dumps(repr(found)) != json.dumps(repr(truth)):
            raise AssertionError(f"{name} was changed and is read as if nothing had happened")
        return "complete", name

    return check


FILES = {
    "cell": _cell, "tables": _tables, "page": _json("page.json", read_page),
    "manifest": _json("manifest.json", manifest.read_settings),
}  # fmt: skip
