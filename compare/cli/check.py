"""The commands ``rattle check``, what checks the installation and the paper, and ``rattle
warm-up``."""

import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import rattle as rt
from rattle.compare.cli import shared
from rattle.compare.cli.ranges import Range
from rattle.compare.cli.shared import SWEEP_POINTS, Results, say, say_json, say_lines, say_part
from rattle.scene import OutputError, count, positive

if TYPE_CHECKING:
    from rattle.compare.checks.check import Subject

EXIT_BROKEN = 1
EXTREMES_HELP = "Try extreme values too (rattle check extremes), and put their table on the page."


def run_and_show(
    subjects: Mapping[str, "Subject"],
    *,
    all_checks: bool,
    as_json: bool,
    **asked: Any,
) -> None:
    """Run checks, print them as a table or as JSON, and exit with code 1 unless all hold."""
    from rattle.compare.checks.check import result_lines, results_record, run_checks

    results = run_checks(subjects, **asked)
    if as_json:
        say_json(results_record(results, asked.get("seed", 0)))
    else:
        say_lines(result_lines(results, all_checks=all_checks))
    if not all(result.holds for result in results):
        sys.exit(EXIT_BROKEN)


@click.group(cls=shared.CommandGroup)
def check() -> None:
    """Check this installation, and the claims of the paper."""


@check.command("published")
@shared.several("result", "names", str, "One result alone; repeatable. [default: all]")
@click.option(
    "--all", "all_checks", is_flag=True, help="Print every check and every negative control."
)
@shared.SEED_AND_WORKERS
@shared.json_flag("the record")
def results(**asked: Any) -> None:
    """Compare this installation with published results.

    They are exits, returns, collapse, bounces, exponents and covariances, and a ball and an
    oscillator under noise; each check must also reject its negative controls.

    Exit codes: 0 all results hold; 1 one does not; 2 bad input.
    """
    from rattle.compare.checks.published import RESULTS

    run_and_show(RESULTS, **asked)


@check.command("extremes")
@click.option(
    "--all", "all_checks", is_flag=True, help="Print the range and the reference of every row."
)
@shared.json_flag("the record")
def extreme_values(**asked: bool) -> None:
    """Compare extreme values with independent references.

    Prints the worst errors. References are limits, published results, and exact scaling.

    Exit codes: 0 all rows hold; 1 one does not; 2 bad input.
    """
    from rattle.compare.checks.extremes import EXTREMES

    run_and_show(EXTREMES, **asked)


@check.command()
@shared.several("scheme", "schemes", shared.SCHEME_TYPE, "Scheme; repeatable. [default: all]")
@shared.several("axis", "axes", shared.AXIS_TYPE, "Axis; repeatable. [default: all]")
@shared.whole("points", 7, "Values of each axis, 1 to 7.")
@shared.whole("paths", 32_768, "Most paths of a cell.")
@shared.SEED_AND_WORKERS
@shared.folder(Path("reports/stability"))
@click.option("--extremes/--no-extremes", "extreme", default=True, help=EXTREMES_HELP)
@shared.OVERWRITE
def stability(
    schemes: tuple[str, ...],
    axes: tuple[str, ...],
    out: Path,
    extreme: bool,
    overwrite: bool,
    **counts: int,
) -> None:
    """Measure where each scheme is stable and unbiased.

    At admissible and at longer steps; writes a page. Results are stored in OUT-cells: after an
    interruption the same command continues.

    Exit codes: 0 complete; 1 a run with an admissible step is inaccurate without a diagnostic, or
    an extreme value fails; 2 bad input.
    """
    from rattle.compare.checks.check import run_checks
    from rattle.compare.checks.extremes import EXTREMES
    from rattle.compare.checks.stability.chart import chart, moderate

    chosen = list(dict.fromkeys(schemes or shared.SCHEME_NAMES))
    along = list(dict.fromkeys(axes or shared.AXIS_NAMES))
    count("points", counts["points"], most=7)
    count("paths", counts["paths"], least=1000)
    count("seed", counts["seed"], least=0)
    count("workers", counts["workers"])
    counts = shared.pick(counts, "points", "paths", "seed", "workers")
    results = Results("", out, "stability", "checks.stability.page", overwrite)
    result = chart(chosen, along, **counts, folder=results.cells)
    tried = run_checks(EXTREMES) if extreme else ()
    asked = {"schemes": chosen, "axes": along, **counts}
    results.say(results.write(result, tried, scene=moderate().to_dict(), **asked))
    if len(result.without_diagnostic) or not all(row.holds for row in tried):
        sys.exit(EXIT_BROKEN)


@check.command()
@shared.json_flag("the table")
def speed(as_json: bool) -> None:
    """Measure the time of a step of a path on this machine.

    Beside it stands its lower bound: random numbers and arithmetic alone.
    """
    from rattle.compare.report.provenance import versions
    from rattle.montecarlo.bench import bench as measure

    table = measure()
    if as_json:
        say_json(table.reset_index().to_dict("records"))
        return
    names = {
        "ns": "ns per path-step",
        "ns_wheel": "and wheel",
        "times_floor": "times floor",
        "gain": "times as fast",
        "us": "us per path",
    }
    say(table.rename(columns=names).to_string(float_format="{:.2f}".format, na_rep=""), keep="\n")
    say(
        "Processor time of one core, the least of several turns; ratios are medians. Floor: one"
        " normal and the\narithmetic of one step. Times as fast: as a path-step of the skilled"
        f" loop, or as a normal by standard_normal.\nProcessor: {versions()['processor']}.",
        keep="\n",
    )


# seconds: sections, spectra and pairs; a value of alpha; a path
BASE = 60.0
PER_VALUE = 1.0
PER_PATH = 1e-4


@check.command()
@shared.SCENE_AND_SIGMA
@shared.whole("impacts", 4, "Impacts after the start.")
@shared.whole("paths", 20_000, "Paths of each run.")
@shared.SEED_AND_WORKERS
@shared.json_flag("the table")
def order(
    scene: Path | None, sigma: float | None, seed: int, as_json: bool, **settings: int
) -> None:
    """Measure the order of the step bias of Euler-Maruyama.

    SCENE is a TOML file, DAT21 if none is given.
    """
    from rattle.compare.tradeoff.page import orders_said
    from rattle.compare.tradeoff.weak_order import weak_orders

    table = weak_orders(shared.load_scene(scene, sigma), rng=seed, **settings).table
    if as_json:
        say_json(table.to_dict("records"))
        return
    names = [
        "scheme",
        "moment",
        "quantity",
        "slope",
        "low",
        "high",
        "last",
        "turns",
        "order",
        "change",
        "limit_z",
    ]
    say(table[names].to_string(index=False, float_format="{:.3g}".format, na_rep="-"), keep="\n")
    say_lines(orders_said(table))
    say(
        "slope of the step bias over these dt, in [low, high] with 95 % confidence; last: that at"
        " the finest; turns: impacts at\nwhich the change turns its sign; order: only where the"
        " slope has settled; change: size of the last change, in sds;\nlimit_z: Richardson"
        " extrapolation minus exact flights in standard errors; -: hidden by noise.",
        keep="\n",
    )


@check.command()
@shared.several("sigma", "sigmas", float, "Noise of a validation; repeatable. [default: 0.01, 0.1]")
@shared.over("Values of alpha.", "alpha=0.05:2.5:100", only="alpha")
@shared.whole("paths", 100_000, "Paths of each validation.")
@shared.whole("points", 1_000_000, "Points of each Poincare section.")
@shared.whole("impacts", 200_000, "Impacts of the spectra.")
@shared.SEED_AND_WORKERS
@shared.folder_options(Path("reports/claims"))
def claims(
    sigmas: tuple[float, ...], over: Range, out: Path, overwrite: bool, **counts: int
) -> None:
    """Judge each claim of the paper on its own example, DAT21.

    Writes test, evidence and verdict of every claim that can be tested. Results of the sweep are
    stored in OUT-cells: after an interruption the same command continues with them.

    Exit codes: 0 complete, whatever the verdicts; 2 bad input.
    """
    from rattle.compare.chaos.effort import Effort
    from rattle.compare.checks.claims.evidence import gather
    from rattle.compare.checks.claims.judges import judge

    scene = rt.Scene.from_gears(rt.DAT21)
    at = over.values(scene, SWEEP_POINTS)
    levels = sigmas or (0.01, 0.1)
    for sigma in levels:
        positive("sigma", sigma)
    counts = shared.pick(counts, "impacts", "paths", "points", "seed", "workers")
    paths = count("paths", counts["paths"], least=1000)
    effort = Effort(**shared.pick(counts, "points", "impacts", "seed", "workers")).check()
    results = Results("DAT21", out, "claims", "checks.claims.page", overwrite)
    minutes = (BASE + PER_VALUE * len(at) + PER_PATH * paths * (len(levels) + 1)) / 60.0
    say(f"About {minutes:.1g} minutes of processor time, and what has to be compiled.", err=True)
    evidence = gather(scene, levels, at, paths, effort, say_part, results.cells)
    judged = judge(evidence)
    asked = {"sigmas": levels, "over": at, **counts}
    answer = results.write(judged, evidence.chaos, scene=evidence.scene.to_dict(), **asked)
    verdicts = [f"{k:2d}. {claim.name}: {claim.verdict}" for k, claim in enumerate(judged, start=1)]
    results.say([*answer, *verdicts])


@click.command("warm-up")
@click.option(
    "--times",
    is_flag=True,
    help="Compile all anew in this process alone, and print how long it takes.",
)
def warm_up(times: bool) -> None:
    """Compile all machine code now.

    Then no later command has to; without it each command compiles what it needs when it first runs.
    Machine code is kept for this user, this installation and this kind of processor. As many
    processes compile as there are cores, or as the environment variable RATTLE_COMPILERS says.

    Exit codes: 0 done; 2 it cannot be kept.
    """
    from rattle.compare.warm_up import (
        LONGEST_TASK,
        WARM_UP,
        compile_tasks,
        kept_tasks,
        measure_times,
        tasks,
    )
    from rattle.scene import compile_ahead
    from rattle.scene.compiled import INTERPRETED
    from rattle.scene.progress import ProgressBar

    if INTERPRETED:
        say("nothing is compiled: numba is off (NUMBA_DISABLE_JIT)")
        return
    if times:
        say(measure_times(tasks()).to_string(float_format="{:.2f}".format), keep="\n")
        return
    started = time.perf_counter()
    kept = kept_tasks()
    if kept is None:
        raise OutputError(
            "machine code cannot be kept: set NUMBA_CACHE_DIR to a folder of your own"
        )
    compile_ahead.expect(WARM_UP)
    all_tasks = tasks()
    before = kept.count()
    named = compile_tasks(all_tasks, kept, LONGEST_TASK)
    for name in (bar := ProgressBar(named, label="compiling", unit="task", total=len(all_tasks))):
        bar.set_postfix_str(name)
    seconds = time.perf_counter() - started
    say(f"{kept.count() - before} functions compiled in {seconds:.0f} s; kept in {kept.place}")
