"""The command ``rattle claims``."""

from pathlib import Path

import click

from rattle.compare.cli.console import say, say_part
from rattle.compare.cli.options import WHOLE

BASE, PER_VALUE, PER_PATH = 60.0, 1.0, 1e-4  # seconds: sections, spectra and pairs; a value of alpha; a path


@click.command()
@click.option(
    "--sigma", "sigmas", multiple=True, type=float, help="Noise of a validation; repeatable. [default: 0.01, 0.1]"
)
@click.option("--over", default="0.05:2.5:100", show_default=True, metavar="LOW:HIGH:POINTS", help="Values of alpha.")
@click.option("--paths", type=WHOLE, default=100_000, show_default=True, help="Paths of each validation.")
@click.option("--points", type=WHOLE, default=1_000_000, show_default=True, help="Points of each Poincare section.")
@click.option("--impacts", type=WHOLE, default=200_000, show_default=True, help="Impacts of the spectra.")
@click.option("--seed", type=WHOLE, default=0, show_default=True, help="Seed.")
@click.option("--workers", type=WHOLE, default=2, show_default=True, help="Threads; the result does not depend on it.")
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("reports/claims"), show_default=True, help="Folder."
)
@click.option("--overwrite", is_flag=True, help="Replace earlier results in that folder.")
def claims(
    sigmas: tuple[float, ...],
    over: str,
    paths: int,
    points: int,
    impacts: int,
    seed: int,
    workers: int,
    out: Path | None,
    overwrite: bool,
) -> None:
    """Judge each claim of the paper on its own example, DAT21.

    Writes test, evidence and verdict of every claim that can be tested.

    Exit codes: 0 complete, whatever the verdicts; 2 bad input.
    """
    from rattle.compare.chaos.sweep import values
    from rattle.compare.claims.evidence import gather
    from rattle.compare.claims.judge import CLAIMS, judge
    from rattle.compare.claims.page import CONTENTS, write_claims
    from rattle.compare.report.folder import check_free
    from rattle.compare.report.provenance import Stopwatch, provenance
    from rattle.scene import DAT21, Scene
    from rattle.scene.validate import count, positive

    at = values("over", over)
    levels = sigmas or (0.01, 0.1)
    for sigma in levels:
        positive("sigma", sigma)
    for name, number, least in (("paths", paths, 1000), ("points", points, 100), ("impacts", impacts, 20_000)):
        count(name, number, least=least)
    count("workers", workers)
    out = out or Path("reports/claims")
    check_free(out, CONTENTS, overwrite)
    minutes = (BASE + PER_VALUE * len(at) + PER_PATH * paths * (len(levels) + 1)) / 60.0
    say(f"About {minutes:.1g} minutes of processor time, and what has to be compiled.", err=True)
    watch = Stopwatch()
    found = gather(
        Scene.from_gears(DAT21),
        sigmas=levels,
        at=at,
        paths=paths,
        seed=seed,
        workers=workers,
        points=points,
        spectrum_impacts=impacts,
        progress=say_part,
    )
    judged = judge(found)
    record = {
        "name": "DAT21",
        "scene": found.scene.to_dict(),
        "sigmas": list(levels),
        "over": list(at),
        "paths": paths,
        "points": points,
        "impacts": impacts,
        "seed": seed,
        "workers": workers,
        **provenance(watch),
    }
    for sentence in write_claims(out, judged, [c.__name__ for c in CLAIMS], found.chaos, record, overwrite):
        say(sentence)
    for number, claim in enumerate(judged, start=1):
        say(f"{number:2d}. {claim.name}: {claim.verdict}")
    say(f"Page: {out / 'claims.html'}")
