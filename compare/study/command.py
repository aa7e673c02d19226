"""The command ``rattle study``."""

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from compare.console import say, say_json
from scene.errors import InputError
from scene.text import line

if TYPE_CHECKING:
    from compare.study.design import Study
    from compare.study.store import Store

__all__ = ["study"]


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), default=None, help="Folder. [default: FILE without its suffix]")
@click.option("--workers", type=int, default=2, show_default=True, help="Threads; the results do not depend on it.")
@click.option("--scheduler", default=None, metavar="tcp://HOST:PORT", help="Compute on a running Dask cluster instead.")
@click.option("--explain", is_flag=True, help="Say what there is to compute and what it would take, and stop.")
@click.option("--status", is_flag=True, help="Say what is there, and stop.")
@click.option("--json", "as_json", is_flag=True, help="Print the record as JSON.")
def study(
    file: Path, out: Path | None, workers: int, scheduler: str | None, explain: bool, status: bool, as_json: bool
) -> None:
    """Compute what is missing of the study in FILE (TOML), and write its tables, figures and page.

    Every result is kept as soon as it is there; the same command goes on where it was ended.  Exit codes: 0 complete;
    1 complete but for what cannot be computed at some points, with the reasons; 2 bad input; 130 interrupted.
    """
    from compare.folder import within, write_whole
    from compare.study.design import Study
    from compare.study.lacking import lacking
    from compare.study.store import Store
    from compare.study.tables import CELLS, FILE
    from scene.validate import count

    count("workers", workers)
    wanted = Study.load(file)
    _ = wanted.points  # what cannot be computed is known before anything is made
    folder = out or file.with_suffix("")
    if folder.resolve() == file.resolve():
        raise InputError("out", str(folder), "is the study file itself; give --out a folder")
    if explain or status:
        store = Store(folder / CELLS) if (folder / CELLS).is_dir() else None
        say(_explained(wanted, store, workers) if explain else _status(wanted, store))
        return
    within(folder, CELLS)
    store = Store(folder / CELLS)
    write_whole(folder / FILE, wanted.text)
    record = _record(wanted, store, folder, file, workers, scheduler)
    if as_json:
        say_json(record)
    else:
        for sentence in record["answer"]:
            say(sentence)
        say(f"Page: {folder / 'study.html'}")
    lacks = lacking(wanted.points, record.get("failed", {}))
    for lack in lacks:
        say(f"rattle: {lack}", err=True)
    if lacks:
        sys.exit(1)


def _record(
    wanted: "Study", store: "Store", folder: Path, file: Path, workers: int, scheduler: str | None
) -> dict[str, Any]:
    """Run the study and write its page; the record of what is there."""
    from compare.study.current import is_current

    current = is_current(wanted, folder)
    if current and all(store.path(cell.key).exists() for cell in wanted.cells):
        say(f"All {len(wanted.cells)} cells are there, and the page is of them.", err=True)
        return current

    from compare.manifest import command_line
    from compare.study.engine import run
    from compare.study.page import write_page
    from compare.study.places import Cluster, Here, Place
    from compare.study.results import Results

    def unchanged() -> bool:
        try:
            return file.read_text(encoding="utf-8") == wanted.text
        except (OSError, UnicodeDecodeError):
            return False

    started = time.perf_counter()
    place: Place = Cluster(scheduler) if scheduler else Here(workers)
    outcome = run(wanted, store, place, show=True, unchanged=unchanged)
    facts = {
        "command": command_line(sys.argv[1:]), "computed": outcome.computed, "failed": outcome.failed,
        "wall_seconds": round(outcome.wall_seconds, 2), "cell_seconds": round(outcome.cell_seconds, 2),
    }  # fmt: skip
    record = write_page(folder, Results.of(wanted, store), facts)
    took = time.perf_counter() - started
    say(f"{outcome.computed} cells computed, {len(wanted.cells)} there, {took:.1f} s.", err=True)
    return record


def _explained(wanted: "Study", store: "Store | None", workers: int) -> str:
    from compare.study.engine import missing
    from compare.study.estimate import estimate, scaling
    from compare.study.lacking import lacking

    todo = missing(wanted, store) if store else wanted.cells
    work = estimate(todo, workers)
    lines = [f"{line(wanted.title)}: {len(wanted.points)} points, {len(wanted.cells)} cells, {len(todo)} to compute."]
    lines += [f"  {axis_text}" for axis_text in _axes_text(wanted)]
    lines += [f"  {line(str(lack))}" for lack in lacking(wanted.points, {})]
    lines.append(
        f"About {work.core_seconds:.0f} core-seconds, {work.wall_seconds:.0f} s on {workers} threads, "
        f"{work.megabytes:.0f} MB (nominal; the first run compiles for about a minute"
        + (", an accuracy may cost more where tails are heavy)." if _asks_accuracy(wanted) else ").")
    )
    lines.append("What more cores would do (Dask):")
    lines.append(scaling(todo).to_string(index=False, float_format="{:.3g}".format))
    return "\n".join(lines)


def _asks_accuracy(wanted: "Study") -> bool:
    return any(p.sample is not None and p.sample.accuracy is not None for p in wanted.points)


def _axes_text(wanted: "Study") -> list[str]:
    return [
        f"{name}: {len(axis.values)} values, {line(str(axis.values[0][i]))} to {line(str(axis.values[-1][i]))}"
        + (f" (with {', '.join(n for n in axis.names if n != name)})" if len(axis.names) > 1 else "")
        for axis in wanted.axes
        for i, name in enumerate(axis.names)
    ]


def _status(wanted: "Study", store: "Store | None") -> str:
    from compare.study.engine import missing
    from compare.study.lacking import lacking

    todo = missing(wanted, store) if store else wanted.cells
    lines = [f"{line(wanted.title)}: {len(wanted.cells) - len(todo)} of {len(wanted.cells)} cells are there."]
    left: dict[str, int] = {}
    for cell in todo:
        kind = getattr(cell, "reading", "ensembles")
        left[kind] = left.get(kind, 0) + 1
    lines += [f"  missing: {number} {kind}" for kind, number in left.items()]
    if store:
        lines += [
            f"  set aside: {line(p.read_text(encoding='utf-8', errors='replace'))}"
            for p in sorted(store.aside.glob("*.txt"))
        ]
    lines += [f"  {line(str(lack))}" for lack in lacking(wanted.points, {})]
    return "\n".join(lines)
