"""A block of paths with its sums, to the last bit; as a program it prints them.

It takes no more than the kernel of ``euler-maruyama`` and a trial of exact flights, for each
process that prints it compiles all for itself.  `everything` has the other samplers and the
closures.
"""

import json
import sys

import numpy as np

from rattle.closure.section_map import pieces
from rattle.montecarlo.kernel.block import Plan, run
from rattle.montecarlo.schemes.short_flight import short_flight
from rattle.montecarlo.statistics.section_statistics import single_statistics
from rattle.scene import DAT21, Scene, Tolerance
from rattle.scene.drive import sine_cosine
from rattle.scene.flight import NODES, WEIGHTS

FIXED = np.array([40, 111])  # finest steps; the second within a group of four


def constant():
    """What no seed changes: a quadrature, the parts of a normal deviation, and a short flight."""
    c = Scene.from_gears(DAT21, sigma=0.8).constants
    end, phase = short_flight(c, sine_cosine(2.9), 0.03, (0.1, -1.0, 0.2, 1.3), 0.1, -0.02)
    return {"nodes": [NODES, WEIGHTS], "pieces": list(pieces("normal")), "flight": [*end, *phase]}


def numbers(seed=3):
    """Impacts of 300 paths between walls that impacts redraw, and the sums over them, as
    hexadecimal floats."""
    scene = Scene.from_gears(
        DAT21, sigma=0.8, tolerance=Tolerance(0.04, 0.02, distribution="normal", draw="contact")
    )
    plan = Plan(
        scene,
        300,
        4,
        5e-3,
        "euler-maruyama",
        np.random.SeedSequence(seed),
        2000,
        FIXED,
        {"a": (1, 2, -1, -2)},
        1,
        keep=True,
    )
    result, rows = run(plan, 0)
    joined = result.merge(result)
    parts = {"impacts": rows, "codes": joined.codes}
    for name, s in joined.sums.items():
        parts |= {f"{name}, n": s.n, f"{name}, means": s.mean, f"{name}, sums": s.sums}
    parts |= {
        f"statistics, {name}": value
        for name, value in single_statistics(joined.sums["section"]).items()
    }
    parts |= constant()
    return {name: [float(x).hex() for x in np.ravel(part)] for name, part in parts.items()}


if __name__ == "__main__":
    json.dump(numbers(), sys.stdout)
