"""Scene files and study files through the command line, and what was written read back."""

import contextlib
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import tomli_w
from click.testing import CliRunner, Result
from commands import strict
from fuzz_must import Ended, has_verdicts, must, refused

from rattle.compare.cli.main import main
from rattle.compare.cli.terminal import read_page
from rattle.compare.study.folder import load_study
from rattle.montecarlo import simulate
from rattle.scene import Scene
from rattle.scene.errors import FileError


def ran(words: list[str], folder: Path) -> Result:
    """A command line that has ended as ours do, begun in a folder: a report without --out goes
    below it."""
    with contextlib.chdir(folder):
        done = CliRunner().invoke(main, words)
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    must(done.exit_code in (0, 1, 2, 3, 4), "exit code", done.exit_code, done.output)
    if done.exit_code == 2:
        reason = any(word in done.stderr for word in ("rattle: ", "Error: ", "Usage: "))
        must(
            reason and "Traceback" not in done.output,
            "exit code 2 without a reason:",
            done.output,
            done.stderr,
        )
    return done


def simulate_file(scene: Scene, settings: dict[str, Any]) -> Ended:
    """``rattle simulate FILE``: its JSON, its CSV file and the call in Python say the same."""
    with tempfile.TemporaryDirectory(prefix="rattle-fuzz-") as folder:
        place = Path(folder)
        done = _on_file(
            place, "simulate", scene, settings, "--json", "--workers", "1", "--out", "section.csv"
        )
        if done.exit_code == 2:
            return "refused", "simulate"
        said = strict(done.stdout)
        kept = pd.read_csv(place / "section.csv", index_col="impact")
    section = pd.DataFrame(said["section"]).set_index("impact").astype(float)
    must(list(kept) == list(section), "columns", list(kept), list(section))
    must(
        np.array_equal(kept.to_numpy(float), section.to_numpy(), equal_nan=True),
        "CSV and JSON\n",
        kept,
        section,
    )
    must(
        (section["agreement"] >= 0.0) & (section["agreement"] <= 1.0),
        "agreement",
        section["agreement"],
    )
    if "paths" not in settings:
        must(
            ("NOT" in said["reach"]) == (done.exit_code == 3),
            "exit code",
            done.exit_code,
            said["reach"],
        )
        return ("complete", "") if done.exit_code == 0 else ("stopped", "budget")
    given = {name: value for name, value in settings.items() if name != "seed"}
    run = simulate(scene, rng=settings["seed"], **given)
    must(
        np.array_equal(run.section.to_numpy(float), section.to_numpy(), equal_nan=True),
        "Python\n",
        run.section,
    )
    return ("stopped", "unfinished paths") if run.unfinished else ("complete", "")


def validate_file(scene: Scene, settings: dict[str, Any]) -> Ended:
    """``rattle validate FILE``: its page can be shown, and its tables hold verdicts."""
    with tempfile.TemporaryDirectory(prefix="rattle-fuzz-") as folder:
        place = Path(folder)
        done = _on_file(
            place,
            "validate",
            scene,
            settings,
            "--no-validity",
            "--workers",
            "1",
            "--json",
            "--out",
            "r",
        )
        if done.exit_code == 2:
            return "refused", "validate"
        must(strict(done.stdout)["answer"], "no answer")
        read_page(place / "r")
        must(ran(["show", "r"], place).exit_code == 0, "show")
    return "complete", ""


def study_file(scene: Scene, settings: dict[str, Any]) -> Ended:
    """``rattle study FILE``: what it says at first it says again, and its tables can be read
    back."""
    text = tomli_w.dumps({**scene.to_dict(), **settings})
    with tempfile.TemporaryDirectory(prefix="rattle-fuzz-") as folder:
        place = Path(folder)
        (place / "study.toml").write_text(text, encoding="utf-8")
        words = ["study", "study.toml", "--workers", "1", "--json", "--out", "r"]
        done = ran(words, place)
        if done.exit_code == 2:
            return "refused", "study"
        first = strict(done.stdout)
        again = strict(ran(words, place).stdout)
        must(
            first["answer"] == again["answer"],
            "the same study says something else",
            first["answer"],
            again["answer"],
        )
        must(ran(["show", "r"], place).exit_code == 0, "show")
        try:
            tables = load_study(place / "r")
        except FileError as error:
            must(False, "what was written cannot be read back", refused(error, ""), error)
    if len(tables.errors):
        has_verdicts(tables.errors)
    if len(tables.sections):
        share = tables.sections["agreement"].dropna()
        must((share >= 0.0) & (share <= 1.0), "agreement", share)
    return (
        ("complete", "") if done.exit_code == 0 else ("stopped", "points that cannot be computed")
    )


def _on_file(place: Path, command: str, scene: Scene, settings: dict[str, Any], *more: str) -> Any:
    (place / "scene.toml").write_text(scene.to_toml(), encoding="utf-8")
    options = [word for name, value in settings.items() for word in (f"--{name}", str(value))]
    return ran([command, "scene.toml", *options, *more], place)
