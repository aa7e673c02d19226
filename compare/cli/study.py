"""The command ``rattle study``."""

import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

import click

import rattle as rt
from rattle.compare.cli import shared
from rattle.compare.cli.shared import say, say_json, say_lines
from rattle.compare.report.folder import ANY_TEXT, sweep, write_whole
from rattle.compare.report.interrupt import stored
from rattle.compare.report.json_text import Facts
from rattle.scene import InputError, OutputError, RattleError, count, line

LOOKED_AT = 200  # points of a grid from which --explain estimates the cost of all


@click.command()
@click.argument("file", type=shared.FILE_PATH)
@shared.folder("FILE without its suffix")
@shared.whole("workers", 2, "Threads; the results do not depend on it.")
@shared.SCHEDULER
@click.option(
    "--overwrite", is_flag=True, help="Replace the tables of another study in that folder."
)
@click.option(
    "--explain", is_flag=True, help="Print what is to be computed and its expected cost, and stop."
)
@click.option("--status", is_flag=True, help="Print which results are stored, and stop.")
@shared.json_flag("the record")
def study(
    file: Path,
    out: Path | None,
    workers: int,
    scheduler: str | None,
    overwrite: bool,
    explain: bool,
    status: bool,
    as_json: bool,
) -> None:
    """Compute a study of many scenes, described in a TOML file.

    Writes tables, figures and a page. Every result is saved when it is computed; the same command
    continues an interrupted one.

    Exit codes: 0 complete; 1 complete except for results that cannot be computed at some points,
    with the reasons; 2 bad input, or nothing that could be computed; 130 interrupted.
    """
    from rattle.compare.engine.run import CELLS_FOLDER
    from rattle.compare.engine.store import Store
    from rattle.compare.study.folder import check_folder, group_failures

    count("workers", workers)
    wanted = rt.Study.load(file)
    folder = out or file.with_suffix("")
    if folder.resolve() == file.resolve():
        raise InputError("out", str(folder), "is the study file itself; give --out a folder")
    seen = Store(folder / CELLS_FOLDER, read_only=True)
    if explain:
        say(_explain(wanted, seen, workers), keep="\n")
        return
    _ = wanted.points  # finds what cannot be computed before any file is written
    if status:
        todo = seen.missing(wanted.cells)
        have = len(wanted.cells) - len(todo)
        say(f"{line(wanted.title)}: {have} of {len(wanted.cells)} results stored.")
        for group, number in Counter(cell.group for cell in todo).items():
            say(f"  missing: {number} {group}")
        for failure in group_failures(wanted.points, {}):
            say(f"  {line(str(failure))}")
        return
    check_folder(wanted, folder, overwrite)

    def describe() -> str:
        """What is stored after an interruption."""
        number = len(wanted.cells)
        have = number - len(seen.missing(wanted.cells))
        page = ", but their page is not written" if have == number else ""
        return f"{have} of {number} results stored{page}; run the same command again to continue"

    stored.append(describe)
    record = _read_finished(wanted, seen, folder) or _compute(
        wanted, seen, folder, workers, scheduler
    )
    stored.append(lambda: f"all {len(wanted.cells)} results are stored, and their page is written")
    if as_json:
        say_json(record)
    else:
        say_lines(record["answer"])
        if "files" in record:
            say(f"Page: {folder / 'study.html'}")
    failures = group_failures(wanted.points, record.get("failed", {}))
    for failure in failures:
        say(f"rattle: {failure}", err=True)
    if failures:
        sys.exit(1)


def _compute(
    wanted: "rt.Study", seen: Any, folder: Path, workers: int, scheduler: str | None
) -> Facts:
    """Run the study and write its page; returns the record of the page, or only the answer if it
    cannot be written."""
    from rattle.compare.engine.cluster import Cluster
    from rattle.compare.engine.run import Runner, open_cells, run
    from rattle.compare.study.design import combine, page_of, read_results
    from rattle.compare.study.folder import FILE, is_current_file, write_page

    try:
        store = open_cells(folder)
        if not is_current_file(wanted, folder):
            write_whole(folder / FILE, wanted.text)
    except OutputError as error:
        if seen.missing(wanted.cells):
            raise
        say(f"rattle: {error}; all results stored; the page could not be written", err=True)
        return {"answer": page_of(wanted).answer(combine(wanted, read_results(wanted, seen)))}

    started = time.perf_counter()
    runner = Cluster(scheduler) if scheduler else Runner(workers)
    outcome = run(wanted.cells, store, runner, show=True)
    facts = {
        "computed": outcome.computed,
        "failed": outcome.failed,
        "wall_seconds": round(outcome.wall_seconds, 2),
        "cell_seconds": round(outcome.cell_seconds, 2),
    }
    results = read_results(wanted, store)
    tables = combine(wanted, results)
    if outcome.failed and tables.empty:
        why = next(iter(outcome.failed.values()))
        lost = f"{len(outcome.failed)} of {len(wanted.cells)} cells could not be computed"
        raise RattleError(f"study = {wanted.title!r}: nothing can be compared yet, {lost} ({why})")
    seconds = {key: float(result.facts["seconds"]) for key, result in results.items()}
    record = write_page(folder, tables, seconds, facts)
    took = time.perf_counter() - started
    say(f"{outcome.computed} results computed, {len(wanted.cells)} stored, {took:.1f} s.", err=True)
    return record


def _read_finished(wanted: "rt.Study", seen: Any, folder: Path) -> Facts | None:
    """The record of a study whose cells and page are complete; None if something is to be computed
    or written."""
    from rattle.compare.study.folder import FILE, SCRATCH_PART, is_current, is_current_file

    current = is_current(wanted, folder)
    if current is None or seen.missing(wanted.cells):
        return None
    say(f"All {len(wanted.cells)} results are stored, and the page is up to date.", err=True)
    for place, scratch in ((folder, SCRATCH_PART), (folder, ANY_TEXT), (seen.folder, ANY_TEXT)):
        sweep(place, scratch)
    if not is_current_file(wanted, folder):
        write_whole(folder / FILE, wanted.text)
    return current


def _explain(wanted: "rt.Study", seen: Any, workers: int) -> str:
    """What is to be computed, and its expected cost, in lines."""
    from rattle.compare.report.render import render_lines
    from rattle.compare.study.cells import Prediction
    from rattle.compare.study.estimate import estimate, expect_work, scaling
    from rattle.compare.study.folder import group_failures

    points = wanted.some_points(LOOKED_AT)
    sampled = len(points) < wanted.size
    cells = [cell for point in points for cell in point.cells] if sampled else wanted.cells

    def times(cell: object) -> float:
        """How many cells of the study a cell represents."""
        scenes = wanted.scenes if isinstance(cell, Prediction) else wanted.size
        return scenes / len(points) if sampled else 1.0

    todo = seen.missing(cells)
    work_of_each = expect_work(todo)
    columns = [
        (name, values, [other for other in axis.names if other != name])
        for axis in wanted.axes
        for name, values in zip(axis.names, zip(*axis.values, strict=True), strict=True)
    ]
    lines = render_lines(
        "cli/explain.j2",
        study=wanted,
        points=len(points) if sampled else 0,
        cells=sum(map(times, cells)),
        left=sum(map(times, todo)),
        columns=columns,
        failures=group_failures(points, {}),
        work=estimate(todo, work_of_each, workers, times),
        workers=workers,
    )
    seconds = {key: expected.core_seconds for key, expected in work_of_each.items()}
    table = scaling(todo, seconds, times).to_string(index=False, float_format="{:.3g}".format)
    return "\n".join([*lines, table])
