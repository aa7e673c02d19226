"""The commands ``rattle tradeoff`` and ``rattle order``."""

from pathlib import Path
from typing import Any

import click

from rattle.compare.cli.console import say, say_json
from rattle.compare.cli.load import load_scene
from rattle.compare.cli.options import WHOLE


@click.command()
@click.argument("scene", required=False, type=click.Path(path_type=Path))
@click.option("--sigma", type=float, help="Noise intensity. [default: the scene's, or 0.1]")
@click.option("--impacts", type=WHOLE, default=12, show_default=True, help="Impacts after the start.")
@click.option(
    "--accuracy", "accuracies", multiple=True, type=float, help="Error in sds; repeatable. [default: 0.3 to 0.001]"
)
@click.option(
    "--budget",
    type=float,
    default=100.0,
    show_default=True,
    help="Core-seconds up to which a point is run; costlier ones are extrapolated.",
)
@click.option("--seed", type=WHOLE, default=0, show_default=True, help="Seed of the simulations.")
@click.option("--orders/--no-orders", default=True, show_default=True, help="Measure the schemes' weak orders as well.")
@click.option("--workers", type=WHOLE, default=2, show_default=True, help="Threads.")
@click.option("--out", type=click.Path(path_type=Path), default=None, help="Folder. [default: reports/NAME-tradeoff]")
@click.option("--overwrite", is_flag=True, help="Replace earlier results in that folder.")
def tradeoff(
    scene: Path | None,
    sigma: float | None,
    impacts: int,
    accuracies: tuple[float, ...],
    budget: float,
    seed: int,
    orders: bool,
    workers: int,
    out: Path | None,
    overwrite: bool,
) -> None:
    """Measure what an accuracy costs by each scheme and closure.

    SCENE is a TOML file, DAT21 if none is given.

    Exit codes: 0 complete; 2 bad input.
    """
    from rattle.compare.report.folder import check_free, default_place, name_of
    from rattle.compare.report.provenance import Stopwatch, provenance
    from rattle.compare.tradeoff.measure import ACCURACIES, check_accuracies, measure
    from rattle.compare.tradeoff.page import CONTENTS, write_tradeoff
    from rattle.compare.tradeoff.variance_reduction import control_table
    from rattle.compare.tradeoff.weak_order import orders_over
    from rattle.montecarlo import SCHEMES, check_settings
    from rattle.scene.validate import positive

    base = load_scene(scene, sigma, 0.1)
    positive("sigma", base.sigma)
    asked = check_accuracies(accuracies or ACCURACIES)
    positive("budget", budget)
    common: dict[str, Any] = {"impacts": impacts, "workers": workers}
    for scheme in SCHEMES:
        check_settings(base, paths=1, dt=None, scheme=scheme, rng=seed, step_bias=False, **common)
    name = name_of(scene) if scene else "DAT21"
    out = out or default_place(name, "-tradeoff")
    check_free(out, CONTENTS, overwrite)
    watch = Stopwatch()
    found = measure(base, accuracies=asked, budget=budget, seed=seed, **common)
    control = control_table(base, seed=seed, **common)
    sigmas = sorted({base.sigma, base.alpha**0.5})  # its own, and the paper's
    measured = orders_over(base, sigmas, rng=seed, workers=workers) if orders else None
    record = {
        "name": name,
        "scene": base.to_dict(),
        "impacts": impacts,
        "accuracies": asked,
        "budget": budget,
        "seed": seed,
        "orders": orders,
        "workers": workers,
        **provenance(watch),
    }
    for sentence in write_tradeoff(out, found, control, measured, asked, record, overwrite):
        say(sentence)
    say(f"Page: {out / 'tradeoff.html'}")


@click.command()
@click.argument("scene", required=False, type=click.Path(path_type=Path))
@click.option("--sigma", type=float, default=None, help="Noise intensity. [default: the scene's; sqrt(alpha) on DAT21]")
@click.option("--impacts", type=WHOLE, default=4, show_default=True, help="Impacts after the start.")
@click.option("--paths", type=WHOLE, default=20_000, show_default=True, help="Paths of each run.")
@click.option("--seed", type=WHOLE, default=0, show_default=True, help="Seed.")
@click.option("--workers", type=WHOLE, default=2, show_default=True, help="Threads; the result does not depend on it.")
@click.option("--json", "as_json", is_flag=True, help="Print the table as JSON.")
def order(
    scene: Path | None, sigma: float | None, impacts: int, paths: int, seed: int, workers: int, as_json: bool
) -> None:
    """Measure the order of the step bias of Euler-Maruyama.

    SCENE is a TOML file, DAT21 if none is given.
    """
    from rattle.compare.tradeoff.page import orders_said
    from rattle.compare.tradeoff.weak_order import weak_orders

    table = weak_orders(load_scene(scene, sigma), impacts=impacts, paths=paths, rng=seed, workers=workers).table
    if as_json:
        say_json(table.to_dict("records"))
        return
    names = ["scheme", "moment", "quantity", "slope", "low", "high", "last", "turns", "order", "change", "limit_z"]
    say(table[names].to_string(index=False, float_format="{:.3g}".format, na_rep="-"), keep="\n")
    for sentence in orders_said(table):
        say(sentence)
    say(
        "slope of the step bias over these dt, in [low, high] with 95 % confidence; last: that at the finest; turns: "
        "impacts at\nwhich the change turns its sign; order: only where the slope has settled; change: size of the "
        "last change, in sds;\nlimit_z: Richardson extrapolation minus exact flights in standard errors; -: hidden by "
        "noise.",
        keep="\n",
    )
