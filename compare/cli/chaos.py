"""The commands ``rattle chaos`` and ``rattle claims``."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rattle.compare.cli import shared
from rattle.compare.cli.shared import Begin, Results, say, say_part

if TYPE_CHECKING:
    from rattle.scene import Scene


@click.command()
@shared.SCENE_AND_SIGMA
@shared.name_option("field", shared.FIELDS, "Field of the scene that the sweep varies.", default="alpha")
@shared.grid("over", "0.05:2.5:100", "Its values.")
@click.option("--keep-sigma", is_flag=True, help="Keep the noise along the sweep; else it is the paper's, sqrt(alpha).")
@click.option("--no-sweep", is_flag=True, help="Leave sweep and bifurcation view out.")
@click.option("--width", type=float, default=0.01, show_default=True, help="Widest interval of a largest exponent.")
@shared.whole("points", 1_000_000, "Points of each Poincare section.")
@shared.whole("impacts", 200_000, "Impacts of the spectra.")
@shared.whole("events", 4000, "Pairs of paths behind each figure.")
@shared.SEED_AND_WORKERS
@shared.report("reports/NAME-chaos", "chaos.page")
def chaos(base: "Scene", begin: Begin, over: str, keep_sigma: bool, no_sweep: bool, **settings: Any) -> None:
    """Measure Lyapunov exponents, Poincare sections and spectra.

    They say whether the motion of SCENE (a TOML file, DAT21 if none is given) is chaotic, also over a sweep.

    Exit codes: 0 complete; 2 bad input.
    """
    from rattle.compare.chaos.measure import study
    from rattle.compare.chaos.page import write_chaos
    from rattle.compare.chaos.sweep import paper_noise, values, vary
    from rattle.scene.errors import positive

    field, at = settings["field"], () if no_sweep else values("over", over)
    noise = None if keep_sigma or field == "sigma" else paper_noise
    scenes = vary(base, field, at, noise) if noise else vary(base, field, at)
    positive("width", settings["width"])
    shared.check_counts(settings, points=100, impacts=20_000, events=128, workers=1)
    results = begin()
    found = study(base, scenes=scenes, progress=say_part, **settings)
    said = "the scene's" if noise is None else "sqrt(alpha)"
    answer = results.write(write_chaos, found, scene=base.to_dict(), **settings, over=list(at), noise=said)
    results.say(answer, "chaos.html")


BASE, PER_VALUE, PER_PATH = 60.0, 1.0, 1e-4  # seconds: sections, spectra and pairs; a value of alpha; a path


@click.command()
@shared.several("sigma", "sigmas", float, "Noise of a validation; repeatable. [default: 0.01, 0.1]")
@shared.grid("over", "0.05:2.5:100", "Values of alpha.")
@shared.whole("paths", 100_000, "Paths of each validation.")
@shared.whole("points", 1_000_000, "Points of each Poincare section.")
@shared.whole("impacts", 200_000, "Impacts of the spectra.")
@shared.SEED_AND_WORKERS
@shared.folder_options(Path("reports/claims"))
def claims(sigmas: tuple[float, ...], over: str, impacts: int, out: Path, overwrite: bool, **settings: int) -> None:
    """Judge each claim of the paper on its own example, DAT21.

    Writes test, evidence and verdict of every claim that can be tested.

    Exit codes: 0 complete, whatever the verdicts; 2 bad input.
    """
    from rattle.compare.chaos.sweep import values
    from rattle.compare.checks.claims.evidence import gather
    from rattle.compare.checks.claims.judges import judge
    from rattle.compare.checks.claims.page import CONTENTS, write_claims
    from rattle.scene import DAT21, Scene
    from rattle.scene.errors import positive

    at = values("over", over)
    levels = sigmas or (0.01, 0.1)
    for sigma in levels:
        positive("sigma", sigma)
    shared.check_counts(settings | {"impacts": impacts}, paths=1000, points=100, impacts=20_000, workers=1)
    results = Results(None, out, "", CONTENTS, overwrite, as_json=False)
    minutes = (BASE + PER_VALUE * len(at) + PER_PATH * settings["paths"] * (len(levels) + 1)) / 60.0
    say(f"About {minutes:.1g} minutes of processor time, and what has to be compiled.", err=True)
    dat21 = Scene.from_gears(DAT21)
    found = gather(dat21, sigmas=levels, at=at, spectrum_impacts=impacts, progress=say_part, **settings)
    judged = judge(found)
    record: dict[str, Any] = {"sigmas": list(levels), "over": list(at), "impacts": impacts, **settings}
    answer = results.write(write_claims, judged, found.chaos, scene=found.scene.to_dict(), **record)
    verdicts = [f"{number:2d}. {claim.name}: {claim.verdict}" for number, claim in enumerate(judged, start=1)]
    results.say([*answer, *verdicts], "claims.html")
