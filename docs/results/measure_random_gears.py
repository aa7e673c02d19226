"""How far each closure is accurate on random gear sets: docs/results/random_gears.csv.

``python docs/results/measure_random_gears.py`` (two to four minutes on one core).  The sets are
drawn from the seed below and are not tuned on.
"""

import math
import time
from pathlib import Path

import numpy as np
import pandas as pd
from kept_tables import Table, keep, short

from rattle import validate
from rattle.compare.validation.comparison import find_validities
from rattle.scene import Scene, Start

TABLE = Path(__file__).parent / "random_gears.csv"
CLOSURES = ("published", "corrected", "saltation", "branching")
SEED = 1722
SETS = 6
PATHS = 2**15
IMPACTS = 12
INTENSITIES = (0.01, 0.05, 0.2, 0.5, 1.0)
"""sigma over the root of alpha."""


def random_gears(seed=SEED, sets=SETS):
    """Parameters of random gear sets, one and two stages in turn (dimensionless)."""
    rng = np.random.default_rng(seed)
    for i in range(sets):
        stages = 1 + (i + 1) % 2
        g = {
            "alpha": rng.uniform(0.5, 3.0),
            "epsilon": rng.uniform(0.3, 0.95),
            "beta1": rng.uniform(0.02, 0.2),
            "gamma1": rng.uniform(0.0, 0.1),
        }
        other = {
            "beta2": rng.uniform(0.02, 0.2),
            "gamma2": rng.uniform(0.0, 0.1),
            "mu": rng.uniform(0.2, 0.8),
            "gap2": rng.uniform(0.2, 1.0),
        }
        y1 = rng.uniform(1.0, 2.5)
        y2 = rng.uniform(-1.0, 2.0)
        start = Start(
            x1=0.5, y1=round(y1, 2), x2=0.0, y2=round(y2, 2) if stages == 2 else 0.0, mesh=1
        )
        g |= other if stages == 2 else {}
        yield {k: round(float(v), 3) for k, v in g.items()} | {"stages": stages, "start": start}


def measure():
    """Ranges of validity of all sets and noise intensities."""
    rows = []
    for i, gears in enumerate(random_gears()):
        started = time.process_time()
        found = []
        for ratio in INTENSITIES:
            scene = Scene(**gears, sigma=ratio * math.sqrt(gears["alpha"]))
            v = validate(scene, impacts=IMPACTS, paths=PATHS, scheme="exact-flight", rng=i)
            found.append(find_validities([v]).assign(ratio=ratio))
        shown = {k: gears.get(k, math.nan) for k in ("stages", "alpha", "epsilon", "gap2")}
        rows.append(pd.concat(found).assign(set=i + 1, **shown))
        print(f"set {i + 1}: {time.process_time() - started:.0f} s", flush=True)
    columns = [
        "set",
        "stages",
        "alpha",
        "epsilon",
        "gap2",
        "ratio",
        "closure",
        "accurate",
        "not_inaccurate",
        "cause",
    ]
    return pd.concat(rows)[columns]


def table(found: pd.DataFrame) -> Table:
    """How far each closure is accurate."""
    rows = []
    for (_, ratio), of in found.groupby(["set", "ratio"], sort=False):
        first = of.iloc[0]
        by = of.set_index("closure")
        gears = [short(first[name]) for name in ("set", "stages", "alpha", "epsilon", "gap2")]
        reach = [
            f"{by['accurate'][c]:.0f} ({by['not_inaccurate'][c]:.0f})" if c in by.index else "–"
            for c in CLOSURES
        ]
        rows.append([*gears, f"{ratio:g}", *reach])
    return ["set", "stages", "α", "ε", "gap 2", "σ/√α", *CLOSURES], rows


if __name__ == "__main__":
    keep(measure(), TABLE, table, None)
