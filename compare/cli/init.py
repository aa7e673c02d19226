"""The command ``rattle init``: a scene file with every key, its unit, its meaning and the value of DAT21."""

from dataclasses import asdict
from pathlib import Path

import click

from rattle.compare.cli.shared import PATH, say
from rattle.scene.errors import OutputError
from rattle.scene.gears import DAT21
from rattle.scene.parts import Start, Tolerance
from rattle.scene.text import line

HEAD = """\
# A gear pair for rattle: a driver that vibrates, and two loose wheels behind it.
# The values are those of the paper's example, DAT21, which has no mean rotation.  Change them, and try
#     rattle simulate {name} --units physical
#     rattle validate {name}
"""

GEARS = {
    "amplitude": ("mm", "amplitude of the driver's motion on its pitch circle"),
    "epsilon": ("1", "restitution of both meshes, 0 to 1"),
    "omega": ("rad/s", "frequency of the drive; n per minute are 2 pi n / 60"),
    "inertia1": ("kg mm^2", "moment of inertia of wheel 1; 1 kg m^2 is 1e6"),
    "inertia2": ("kg mm^2", "of wheel 2"),
    "radius1": ("mm", "base radius of wheel 1"),
    "radius2": ("mm", "of wheel 2"),
    "backlash1": ("mm", "full backlash between driver and wheel 1"),
    "backlash2": ("mm", "between wheel 1 and wheel 2; backlash1 if left out"),
    "damping1": ("N mm s", "rotational damping of wheel 1's oscillation; 0 if left out"),
    "damping2": ("N mm s", "of wheel 2; damping1 if left out"),
    "torque1": ("N mm", "drag torque on wheel 1; 0 if left out"),
    "torque2": ("N mm", "on wheel 2; torque1 if left out"),
}
DRIVE = """\
# In place of amplitude, one of:
# amplitude_rad = 0.01     # rad      amplitude of the driver's rotation, with driver_radius
# alpha = 1.5              # 1        amplitude over backlash1: another backlash1 is then another drive in mm
"""
ROTATION = """\
# Damping acts on the oscillation alone.  Its drag on the mean rotation, damping * mean speed of the wheel, is
# part of the torque: add it there, or have it added by
# speed_rpm = 800.0        # 1/min    mean speed of the driver, or speed_rad_s in rad/s
# driver_radius = 30.0     # mm       base radius of the driver
"""
DRAWING = """\
# [gears.tolerance]          # as in a drawing; leave it out for exact backlashes
# backlash1 = 0.02         # mm       largest deviation of the full backlash1: the number behind ±
# backlash2 = 0.02         # mm       of backlash2
# distribution = "uniform" #          "uniform", "normal" (sd of half the deviation, cut there) or "fixed"
# draw = "path"            #          "path": one draw for a gear set; "contact": anew for each contact
"""
SCENE = """\
[scene]                      # dimensionless; time is omega t, lengths are in units of backlash1
sigma = 0.08               # 1        intensity of the white noise on the drive, here of 3 % rms from 0 to 50 Hz:
#                                     alpha * 0.03 * sqrt(omega / (2 * 50 Hz)), Gears.sigma_from; if left out, no noise
# correlation_time = 3.0   # 1        memory of the noise, in units of 1/omega; white if left out
# A drive of more orders than one sine: tables [[drive]], as in examples/engine-orders.toml; a measured one:
# [drive] with a file, as in examples/measured-drive.toml.
stages = 2                 # 1        1: driver and wheel 1 alone; the values of wheel 2 may then be left out
"""
START = {
    "tau": "time, and phase of the drive alpha sin(tau)",
    "x1": "displacement of the driver relative to wheel 1; a flank is at ±0.5",
    "y1": "its velocity",
    "x2": "displacement of wheel 2 relative to wheel 1; a flank is at ±0.5 backlash2 / backlash1",
    "y2": "its velocity",
    "mesh": "1 or 2: that mesh is struck at once; 0: a start in flight",
}
TOLERANCE = {
    "c1_max": "largest deviation of half of backlash1, in units of backlash1",
    "c2_max": "of half of backlash2, in the same units",
    "distribution": "as in [gears.tolerance]",
    "draw": "as in [gears.tolerance]",
}
PLAIN = """\
# A scene without gears has no [gears]; [scene] then has these in addition, all dimensionless:
# alpha = 1.5              # amplitude of the drive
# epsilon = 0.9            # restitution
# beta1 = {beta1:.6f}         # damping of wheel 1, d1 / (I1 omega)
# beta2 = {beta2:.6f}         # of wheel 2
# gamma1 = {gamma1:.6f}        # drag of wheel 1, T1 R1 / (I1 nu1 omega^2)
# gamma2 = {gamma2:.6f}        # of wheel 2
# mu = {mu:.6f}            # wheel 1's share of the change of y2 at mesh 2: I2 R1^2 / (I1 R2^2 + I2 R1^2)
# gap1 = 0.5               # half gaps
# gap2 = 0.5
"""


def template(name: str) -> str:
    """Text of a scene file with DAT21's values.

    Examples
    --------
    >>> from rattle.scene import Scene
    >>> scene = Scene.from_toml(template("gears.toml"))
    >>> round(scene.alpha, 12), round(scene.gears.sigma_from(rms=0.03, bandwidth=50.0), 2) == scene.sigma
    (1.5, True)
    """
    values = asdict(DAT21) | {"amplitude": round(DAT21.amplitude, 6)}
    gears = [_row(key, values[key], *GEARS[key]) for key in GEARS]
    gears.insert(1, DRIVE)
    start = asdict(Start(0.0, 0.5, 2.0, DAT21.gap2, 2.0, mesh=1))
    tolerance = asdict(Tolerance(0.05, 0.05))
    model = {f"{kind}{i}": getattr(DAT21, kind)(i) for kind in ("beta", "gamma") for i in (1, 2)}
    parts = [
        HEAD.format(name=line(name)),
        "[gears]\n" + "".join(gears) + ROTATION,
        DRAWING,
        SCENE,
        "[scene.start]                # leave it out for the paper's start, which is this one\n"
        + "".join(_row(key, start[key], "1", text) for key, text in START.items()),
        "# [scene.tolerance]          # in place of [gears.tolerance]\n"
        + "".join("# " + _row(key, tolerance[key], "1", text) for key, text in TOLERANCE.items()),
        PLAIN.format(mu=DAT21.mu, **model),
    ]
    return "\n".join(parts)


def _row(key: str, value: object, unit: str, meaning: str) -> str:
    written = f'"{value}"' if isinstance(value, str) else repr(value)
    return f"{f'{key} = {written}':<26} # {unit:<8} {meaning}\n"


@click.command()
@click.argument("file", type=PATH, default=Path("gears.toml"))
def init(file: Path) -> None:
    """Write a scene file to start from, with comments.

    Every key has its unit, its meaning and the value of DAT21. FILE is gears.toml if none is given; an existing file is
    never replaced.

    Exit codes: 0 written; 2 not.
    """
    text = template(file.name)
    try:
        with file.open("x", encoding="utf-8") as new:
            new.write(text)
    except FileExistsError:
        raise OutputError(f"{file}: exists already; give another name") from None
    except OSError as error:
        raise OutputError(f"{file}: cannot be written ({error.strerror}); give another place") from None
    say(f"{file}: a gear pair to change; then: rattle simulate {file} --units physical")
