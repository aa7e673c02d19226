"""The commands ``rattle chaos`` and ``rattle claims``."""

from pathlib import Path
from typing import Any

import click

from rattle.compare.cli import shared
from rattle.compare.cli.shared import load_scene, say, say_lines, say_part


@click.command()
@shared.SCENE
@shared.SIGMA
@shared.named("field", shared.FIELDS, "Field of the scene that the sweep varies.", default="alpha")
@shared.grid("over", "0.05:2.5:100", "Its values.")
@click.option("--keep-sigma", is_flag=True, help="Keep the noise along the sweep; else it is the paper's, sqrt(alpha).")
@click.option("--no-sweep", is_flag=True, help="Leave sweep and bifurcation view out.")
@click.option("--width", type=float, default=0.01, show_default=True, help="Widest interval of a largest exponent.")
@shared.whole("points", 1_000_000, "Points of each Poincare section.")
@shared.whole("impacts", 200_000, "Impacts of the spectra.")
@shared.whole("events", 4000, "Pairs of paths behind each figure.")
@shared.whole("seed", 0, "Seed of the noise.")
@shared.WORKERS
@shared.folder("reports/NAME-chaos")
@shared.OVERWRITE
def chaos(
    scene: Path | None,
    sigma: float | None,
    over: str,
    keep_sigma: bool,
    no_sweep: bool,
    workers: int,
    out: Path | None,
    overwrite: bool,
    **settings: Any,
) -> None:
    """Measure Lyapunov exponents, Poincare sections and spectra.

    They say whether the motion of SCENE (a TOML file, DAT21 if none is given) is chaotic, also over a sweep.

    Exit codes: 0 complete; 2 bad input.
    """
    from rattle.compare.chaos.measure import study
    from rattle.compare.chaos.page import CONTENTS, write_chaos
    from rattle.compare.chaos.sweep import paper_noise, values, vary
    from rattle.compare.report.provenance import Stopwatch, provenance
    from rattle.scene.errors import count, positive

    base = load_scene(scene, sigma)
    at = () if no_sweep else values("over", over)
    noise = None if keep_sigma or settings["field"] == "sigma" else paper_noise
    scenes = vary(base, settings["field"], at, noise) if noise else vary(base, settings["field"], at)
    positive("width", settings["width"])
    for name, least in (("points", 100), ("impacts", 20_000), ("events", 128)):
        count(name, settings[name], least=least)
    count("workers", workers)
    name, out = shared.results_folder(scene, out, "-chaos", CONTENTS, overwrite)
    watch = Stopwatch()
    found = study(base, scenes=scenes, workers=workers, progress=say_part, **settings)
    record = {
        "name": name,
        "scene": base.to_dict(),
        **{key: settings[key] for key in ("points", "impacts", "events", "width", "seed", "field")},
        "over": list(at),
        "workers": workers,
        "noise": "the scene's" if noise is None else "sqrt(alpha)",
        **provenance(watch),
    }
    say_lines(write_chaos(out, found, record, overwrite))
    say(f"Folder: {out}")


BASE, PER_VALUE, PER_PATH = 60.0, 1.0, 1e-4  # seconds: sections, spectra and pairs; a value of alpha; a path


@click.command()
@shared.several("sigma", "sigmas", float, "Noise of a validation; repeatable. [default: 0.01, 0.1]")
@shared.grid("over", "0.05:2.5:100", "Values of alpha.")
@shared.whole("paths", 100_000, "Paths of each validation.")
@shared.whole("points", 1_000_000, "Points of each Poincare section.")
@shared.whole("impacts", 200_000, "Impacts of the spectra.")
@shared.whole("seed", 0, "Seed.")
@shared.WORKERS
@shared.folder(Path("reports/claims"))
@shared.OVERWRITE
def claims(sigmas: tuple[float, ...], over: str, impacts: int, out: Path, overwrite: bool, **settings: int) -> None:
    """Judge each claim of the paper on its own example, DAT21.

    Writes test, evidence and verdict of every claim that can be tested.

    Exit codes: 0 complete, whatever the verdicts; 2 bad input.
    """
    from rattle.compare.chaos.sweep import values
    from rattle.compare.claims.evidence import gather
    from rattle.compare.claims.page import CONTENTS, judge, write_claims
    from rattle.compare.report.folder import check_free
    from rattle.compare.report.provenance import Stopwatch, provenance
    from rattle.scene import DAT21, Scene
    from rattle.scene.errors import count, positive

    at = values("over", over)
    levels = sigmas or (0.01, 0.1)
    for sigma in levels:
        positive("sigma", sigma)
    for name, least in (("paths", 1000), ("points", 100)):
        count(name, settings[name], least=least)
    count("impacts", impacts, least=20_000)
    count("workers", settings["workers"])
    check_free(out, CONTENTS, overwrite)
    minutes = (BASE + PER_VALUE * len(at) + PER_PATH * settings["paths"] * (len(levels) + 1)) / 60.0
    say(f"About {minutes:.1g} minutes of processor time, and what has to be compiled.", err=True)
    watch = Stopwatch()
    dat21 = Scene.from_gears(DAT21)
    found = gather(dat21, sigmas=levels, at=at, spectrum_impacts=impacts, progress=say_part, **settings)
    judged = judge(found)
    record = {
        "name": "DAT21",
        "scene": found.scene.to_dict(),
        "sigmas": list(levels),
        "over": list(at),
        "impacts": impacts,
        **{key: settings[key] for key in ("paths", "points", "seed", "workers")},
        **provenance(watch),
    }
    say_lines(write_claims(out, judged, found.chaos, record, overwrite))
    for number, claim in enumerate(judged, start=1):
        say(f"{number:2d}. {claim.name}: {claim.verdict}")
    say(f"Page: {out / 'claims.html'}")
