"""The command ``rattle animate``."""

import sys
from pathlib import Path

import click

from rattle.compare.cli.console import say
from rattle.compare.cli.load import load_scene
from rattle.compare.cli.options import WHOLE


@click.command()
@click.argument("scene", required=False, type=click.Path(path_type=Path))
@click.option("--sigma", type=float, default=None, help="Noise intensity. [default: the scene's; 0.1 on DAT21]")
@click.option(
    "--impacts", type=WHOLE, default=24, show_default=True, help="Impacts of the noise-free orbit to show, 1 to 200."
)
@click.option("--seed", type=WHOLE, default=0, show_default=True, help="Seed of the noisy path.")
@click.option(
    "--out", type=click.Path(path_type=Path), default=None, help="HTML file. [default: reports/NAME-animation.html]"
)
@click.option("--overwrite", is_flag=True, help="Replace an earlier animation of that name.")
def animate(
    scene: Path | None, sigma: float | None, impacts: int, seed: int, out: Path | None, overwrite: bool
) -> None:
    """Draw the moving wheels of a scene in one HTML file.

    The noise-free orbit beside one noisy path. SCENE is a TOML file, DAT21 if none is given. The file has less than 1
    MB and needs no other; open it in any browser.

    Exit codes: 0 written; 2 bad input.
    """
    from rattle.compare.animation import check_file, record, write_animation
    from rattle.compare.animation.record import check_recording
    from rattle.compare.report.folder import default_place, name_of
    from rattle.compare.report.provenance import command_line

    base = load_scene(scene, sigma, 0.1)
    check_recording(base, impacts, seed)
    name = name_of(scene) if scene else "DAT21"
    out = out or Path(f"{default_place(name, '-animation')}.html")
    check_file(out, overwrite)
    shown = record(base, impacts=impacts, seed=seed)
    write_animation(out, shown, name, command_line(sys.argv[1:]), overwrite)
    say(
        f"Animation: {out} ({out.stat().st_size / 1e3:.0f} kB): {shown.orbit.impacts} impacts without noise, "
        f"{shown.path.impacts} with noise in the same time; the same flanks up to impact {shown.agreement}"
    )
