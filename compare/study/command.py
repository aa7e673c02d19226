"""The command ``rattle study``."""

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from compare.page.words import line
from scene.errors import InputError, RattleError

if TYPE_CHECKING:
    from compare.study.design import Study
    from compare.study.store import Store

__all__ = ["study"]


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), default=None, help="Folder. [default: FILE without its suffix]")
@click.option("--workers", type=int, default=2, show_default=True, help="Threads; the results do not depend on it.")
@click.option(
    "--scheduler",
    default=None,
    metavar="tcp://HOST:PORT",
    help="Compute on a running Dask cluster instead. A Dask scheduler has no authentication and runs what it is sent: "
    "use one in a trusted network only, or tls://HOST:PORT with the certificates that Dask's configuration names.",
)
@click.option("--explain", is_flag=True, help="Say what there is to compute and what it would take, and stop.")
@click.option("--status", is_flag=True, help="Say what is there, and stop.")
@click.option("--json", "as_json", is_flag=True, help="Print the record as JSON.")
def study(
    file: Path, out: Path | None, workers: int, scheduler: str | None, explain: bool, status: bool, as_json: bool
) -> None:
    """Compute what is missing of the study in FILE (TOML), and write its tables, figures and page.

    Every result is kept as soon as it is there; the same command goes on where it was ended.  Exit codes: 0 complete;
    1 complete but for points that cannot be computed, with the reasons; 2 bad input; 130 interrupted.
    """
    from compare.folder import within, write_whole
    from compare.study.design import Study
    from compare.study.store import Store
    from compare.study.tables import CELLS, FILE
    from scene.validate import count

    count("workers", workers)
    if scheduler is not None:
        from compare.study.connection import check_address

        check_address(scheduler)
    wanted = Study.load(file)
    _ = wanted.points  # what cannot be computed is known before anything is made
    folder = out or file.with_suffix("")
    if folder.resolve() == file.resolve():
        raise InputError("out", str(folder), "is the study file itself; give --out a folder")
    if explain or status:
        store = Store(folder / CELLS) if (folder / CELLS).is_dir() else None
        click.echo(_explained(wanted, store, workers) if explain else _status(wanted, store))
        return
    within(folder, CELLS)
    store = Store(folder / CELLS)
    write_whole(folder / FILE, wanted.text)
    record = _record(wanted, store, folder, file, workers, scheduler)
    if as_json:
        import json

        click.echo(json.dumps(record, indent=2, ensure_ascii=False))
    else:
        for sentence in record["answer"]:
            click.echo(sentence)
        click.echo(f"Page: {folder / 'study.html'}")
    lacking = [(p.coordinates, why) for p in wanted.points if p.sample is None for why in p.reasons.values()]
    lacking += [(label, why) for label, why in record.get("failed", {}).items()]
    for where, why in lacking:
        click.echo(f"rattle: {where}: {why}", err=True)
    if lacking:
        sys.exit(1)


def _record(
    wanted: "Study", store: "Store", folder: Path, file: Path, workers: int, scheduler: str | None
) -> dict[str, Any]:
    """Run the study and write its page; the record of what is there."""
    from compare.folder import sweep
    from compare.study.current import is_current
    from compare.study.tables import PAGE

    current = is_current(wanted, folder)
    if current and all(store.path(cell.key).exists() for cell in wanted.cells):
        store.sweep()
        sweep(folder, PAGE)
        click.echo(f"All {len(wanted.cells)} cells are there, and the page is of them.", err=True)
        return current

    from compare.manifest import command_line
    from compare.study.engine import run
    from compare.study.page import write_page
    from compare.study.places import Here, Place
    from compare.study.results import Results

    def unchanged() -> bool:
        try:
            return file.read_text(encoding="utf-8") == wanted.text
        except (OSError, UnicodeDecodeError):
            return False

    started = time.perf_counter()
    place: Place = Here(workers)
    if scheduler is not None:
        from compare.study.cluster import Cluster
        from compare.study.connection import silence

        silence()
        place = Cluster(scheduler)
    outcome = run(wanted, store, place, show=True, unchanged=unchanged)
    facts = {
        "command": command_line(sys.argv[1:]), "computed": outcome.computed, "failed": outcome.failed,
        "wall_seconds": round(outcome.wall_seconds, 2), "cell_seconds": round(outcome.cell_seconds, 2),
    }  # fmt: skip
    results = Results.of(wanted, store)
    if outcome.failed and results.errors.empty:
        why = next(iter(outcome.failed.values()))
        raise RattleError(f"nothing can be compared yet, {len(outcome.failed)} cells were not computed: {why}")
    record = write_page(folder, results, facts)
    took = time.perf_counter() - started
    click.echo(f"{outcome.computed} cells computed, {len(wanted.cells)} there, {took:.1f} s.", err=True)
    return record


def _explained(wanted: "Study", store: "Store | None", workers: int) -> str:
    from compare.study.engine import missing
    from compare.study.estimate import estimate, scaling

    todo = missing(wanted, store) if store else wanted.cells
    work = estimate(todo, workers)
    lines = [f"{line(wanted.title)}: {len(wanted.points)} points, {len(wanted.cells)} cells, {len(todo)} to compute."]
    lines += [f"  {axis_text}" for axis_text in _axes_text(wanted)]
    lines += [f"  cannot be computed: {p.coordinates}: {why}" for p in wanted.points for why in p.reasons.values()]
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
        f"{name}: {len(axis.values)} values, {axis.values[0][i]} to {axis.values[-1][i]}"
        + (f" (with {', '.join(n for n in axis.names if n != name)})" if len(axis.names) > 1 else "")
        for axis in wanted.axes
        for i, name in enumerate(axis.names)
    ]


def _status(wanted: "Study", store: "Store | None") -> str:
    from compare.study.engine import missing

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
    lines += [f"  cannot be computed: {p.coordinates}: {why}" for p in wanted.points for why in p.reasons.values()]
    return "\n".join(lines)
