"""The commands along parameters: boundary and sensitivity."""

from functools import partial
from typing import Any

import click

import rattle as rt
from rattle.compare.cli import shared
from rattle.compare.cli.ranges import Range
from rattle.compare.cli.shared import EXIT_NOT_MET, Begin
from rattle.scene import InputError, Scene

SCAN_POINTS = 8  # values of a scan
MAP_VALUES = 9  # values of the second parameter of a map
OVER_HELP = (
    "Parameter of the gears or the scene, its range, and how many values are scanned, evenly spaced"
    " in their logarithm. [default: sigma=0.001:2:8; a fourth of another's value to four times it]"
)
AND_HELP = (
    "A second parameter: trace the boundary over both, at so many of its values. [default: half its"
    " value to twice it, 9 values]"
)
CLOSURE_HELP = "In place of quantities: judge what it predicts."
ACCURACY_HELP = (
    "Half width of the widest 95 % interval of an effect of 1 %, at which it stops; exit 3 if it is"
    " given and not reached. [default: 0.001]"
)
BUDGET_HELP = (
    "Processor seconds, all threads together; compiling, figures and the page are not counted."
    " What it does not allow is said."
)
PARAMETER_BUDGET = 60.0


@click.command()
@shared.SCENE_AND_SIGMA
@click.option("--closure", metavar="NAME", help="Closure. [default: saltation]")
@click.option(
    "--quantity",
    metavar="NAME",
    help="In place of a closure: a quantity of the long run, with --level.",
)
@shared.real("level", "Its level; impacts per second, mm/s or mW for a scene with [gears].")
@shared.over(OVER_HELP, "sigma")
@shared.over(AND_HELP, option="and")
@shared.SCHEDULER
@shared.whole("impacts", 12, "Impacts that must be accurate.")
@shared.real("width", "Every edge is known to ± this share.", 0.1)
@shared.real("budget", f"{BUDGET_HELP} [default: {PARAMETER_BUDGET:g}; none with --and]")
@shared.SEED_AND_WORKERS
@shared.report("reports/NAME-boundary", "parameters.page", shared.JSON_ALONE)
def boundary(
    base: Scene,
    begin: Begin,
    closure: str | None,
    quantity: str | None,
    level: float | None,
    over: Range,
    along: Range | None,
    scheduler: str | None,
    seed: int,
    workers: int,
    **asked: Any,
) -> None:
    """Find where along a parameter a closure stops holding.

    It is accurate up to one value and shown wrong from another. With --and: at each value of a
    second parameter, a map. With --quantity: where a quantity of the long run crosses a level.
    SCENE is a TOML file, DAT21 if none is given. Results are stored in OUT-cells: after an
    interruption the same command continues.
    """
    mapped = along is not None
    budget = asked["budget"]
    if budget is None and not mapped:
        budget = PARAMETER_BUDGET
    for name, value, refused, why in (
        (
            "quantity",
            quantity,
            closure is not None,
            "takes the place of a closure; give one of them",
        ),
        ("quantity", quantity, mapped, "does not go with --and, which maps a closure"),
        ("scheduler", scheduler, not mapped, "goes with --and"),
    ):
        if value is not None and refused:
            raise InputError(name, value, why)
    if (quantity is None) != (level is None):
        raise InputError("level", level, "goes with --quantity; give both or none")
    results = begin()
    settings: dict[str, Any] = {
        "over": over.name,
        "between": over.ends,
        "points": over.points or SCAN_POINTS,
        "width": asked["width"],
        "budget": budget,
    }
    if quantity is not None:
        settings |= {"quantity": quantity, "level": level}
    else:
        settings |= {"closure": closure or "saltation", "impacts": asked["impacts"]}
    if along is not None:
        number = along.points or MAP_VALUES
        settings |= {"along": along.name, "reach": along.ends, "values": number}
        search: Any = partial(rt.boundary_map, scheduler=scheduler, progress=True)
    else:
        search = partial(rt.boundary if quantity is None else rt.crossing, progress="boundary")
    with shared.estimates_shown():
        result = search(base, **settings, folder=results.cells, rng=seed, workers=workers)
    results.conclude(result, **settings, seed=seed)


@click.command()
@shared.SCENE_AND_SIGMA
@shared.several(
    "quantity",
    "quantities",
    str,
    "Quantity; repeatable. [default: energy, impacts and speeds, by mesh]",
)
@shared.several("parameter", "parameters", str, "Parameter; repeatable. [default: all]")
@click.option(
    "--closure", type=shared.ClosureName("closure", shared.CLOSURE_NAMES), help=CLOSURE_HELP
)
@shared.whole("impacts", 4, "Impacts at which a closure is judged.")
@shared.whole("paths", 16_384, "Simulated paths beside a closure, for each change.")
@shared.real("accuracy", ACCURACY_HELP)
@shared.real("slow", "Speed below which an impact is slow.", 0.1)
@shared.real("budget", BUDGET_HELP, PARAMETER_BUDGET)
@shared.SEED_AND_WORKERS
@shared.report("reports/NAME-sensitivity", "parameters.page", shared.JSON_ALONE)
def sensitivity(
    base: Scene,
    begin: Begin,
    quantities: tuple[str, ...],
    parameters: tuple[str, ...],
    closure: str | None,
    seed: int,
    workers: int,
    **asked: Any,
) -> None:
    """Find which parameter changes the rattle, and by how much.

    Impacts a second, energy and speeds for 1 % more of every value of the gears. With --closure:
    what it says of the section means and sds of the first impacts, beside a simulation. SCENE is a
    TOML file, DAT21 if none is given.

    Exit codes: 0 done; 2 bad input, or no stationary motion was reached; 3 the intervals are wider
    than the --accuracy asked for.
    """
    accuracy = asked["accuracy"]
    if closure is not None and quantities:
        raise InputError("closure", closure, "takes the place of --quantity; give one of them")
    from rattle.compare import closure_sensitivity

    results = begin()
    if closure is None:
        settings = shared.pick(asked, "slow", "budget")
        settings |= {} if accuracy is None else {"accuracy": accuracy}
        find: Any = partial(rt.sensitivity, quantities=quantities or None)
    else:
        settings = {"closure": closure} | shared.pick(asked, "impacts", "paths", "budget")
        find = closure_sensitivity
    find = partial(find, parameters=parameters or None, progress="sensitivity")
    with shared.estimates_shown():
        result = find(base, **settings, rng=seed, workers=workers)
    results.conclude(result, **settings, seed=seed)
    if closure is None and accuracy is not None and not result.reached:
        raise click.exceptions.Exit(EXIT_NOT_MET)
