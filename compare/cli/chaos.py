"""The command ``rattle chaos``."""

from pathlib import Path
from typing import Any

import click

from rattle.compare.cli.console import say, say_part
from rattle.compare.cli.load import load_scene
from rattle.compare.cli.options import FIELDS, WHOLE, Name


@click.command()
@click.argument("scene", required=False, type=click.Path(path_type=Path))
@click.option("--sigma", type=float, default=None, help="Noise intensity. [default: the scene's; sqrt(alpha) on DAT21]")
@click.option(
    "--field",
    type=Name("field", FIELDS),
    default="alpha",
    show_default=True,
    help="Field of the scene that the sweep varies.",
)
@click.option("--over", default="0.05:2.5:100", show_default=True, metavar="LOW:HIGH:POINTS", help="Its values.")
@click.option(
    "--keep-sigma",
    is_flag=True,
    help="Keep the noise along the sweep; else it is the paper's, sqrt(alpha).",
)
@click.option("--no-sweep", is_flag=True, help="Leave sweep and bifurcation view out.")
@click.option("--width", type=float, default=0.01, show_default=True, help="Widest interval of a largest exponent.")
@click.option("--points", type=WHOLE, default=1_000_000, show_default=True, help="Points of each Poincare section.")
@click.option("--impacts", type=WHOLE, default=200_000, show_default=True, help="Impacts of the spectra.")
@click.option("--events", type=WHOLE, default=4000, show_default=True, help="Pairs of paths behind each figure.")
@click.option("--seed", type=WHOLE, default=0, show_default=True, help="Seed of the noise.")
@click.option("--workers", type=WHOLE, default=2, show_default=True, help="Threads; the result does not depend on it.")
@click.option("--out", type=click.Path(path_type=Path), default=None, help="Folder. [default: reports/NAME-chaos]")
@click.option("--overwrite", is_flag=True, help="Replace earlier results in that folder.")
def chaos(
    scene: Path | None,
    sigma: float | None,
    field: str,
    over: str,
    keep_sigma: bool,
    no_sweep: bool,
    width: float,
    points: int,
    impacts: int,
    events: int,
    seed: int,
    workers: int,
    out: Path | None,
    overwrite: bool,
) -> None:
    """Measure Lyapunov exponents, Poincare sections and spectra.

    They say whether the motion of SCENE (a TOML file, DAT21 if none is given) is chaotic, also over a sweep.

    Exit codes: 0 complete; 2 bad input.
    """
    from rattle.compare.chaos.measure import study
    from rattle.compare.chaos.page import CONTENTS, write_chaos
    from rattle.compare.chaos.sweep import paper_noise, values, with_field
    from rattle.compare.report.folder import check_free, default_place, name_of
    from rattle.compare.report.provenance import Stopwatch, provenance
    from rattle.scene.validate import count, positive

    base = load_scene(scene, sigma)
    at = () if no_sweep else values("over", over)
    for value in at:
        with_field(base, field, value)
    positive("width", width)
    for name, number, least in (("points", points, 100), ("impacts", impacts, 20_000), ("events", events, 128)):
        count(name, number, least=least)
    count("workers", workers)
    name = name_of(scene) if scene else "DAT21"
    out = out or default_place(name, "-chaos")
    check_free(out, CONTENTS, overwrite)
    settings: dict[str, Any] = {
        "points": points,
        "impacts": impacts,
        "events": events,
        "width": width,
        "seed": seed,
        "field": field,
    }
    watch = Stopwatch()
    noise = None if keep_sigma or field == "sigma" else paper_noise
    found = study(base, at=at, noise=noise, workers=workers, progress=say_part, **settings)
    record = {
        "name": name,
        "scene": base.to_dict(),
        **settings,
        "over": list(at),
        "workers": workers,
        "noise": "the scene's" if noise is None else "sqrt(alpha)",
        **provenance(watch),
    }
    for sentence in write_chaos(out, found, record, overwrite):
        say(sentence)
    say(f"Folder: {out}")
