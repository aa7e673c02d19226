"""Measures the branching closure and its own error bound on the random gear sets, beside exact
flights.

.. code-block:: none

    python docs/results/measure_branching.py reference FOLDER FIRST LAST
    python docs/results/measure_branching.py errors FOLDER FIRST LAST
    python docs/results/measure_branching.py table FOLDER BEFORE

The first writes the moments of exact flights, one csv per gear set and noise; the second compares
the closure with them, and writes ``errors_N.csv``, one line per noise, for gear set N; the third
puts them together as docs/results/branching.csv, beside those that earlier code gave against the
same flights, in the folder BEFORE.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from kept_tables import Table, keep, median_and_most, short

from rattle.closure import mean_map
from rattle.montecarlo import simulate
from rattle.montecarlo.statistics.intervals import widest
from rattle.scene import Scene
from rattle.scene.types import section_names

sys.path.append(str(Path(__file__).parents[2] / "tests" / "helpers"))
from random_gears import gear_sets, noisy

TABLE = Path(__file__).parent / "branching.csv"
# random gear sets; the factors of the bounds were found on the first ones
SETS = 30
TUNED = 15
NOISE = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0)
"""``sigma / sqrt(alpha)``."""
PATHS = 200_000
IMPACTS = 12
TOLERANCE = 0.05
LEEWAY = 3.0  # standard errors: the worst of six quantities is further off once in sixty rows
TIMED = (500, 5_000)  # paths of the two simulations that give the time per path


def spent(call: Callable[[], object]) -> tuple[float, object]:
    """Processor time of a call, and its result."""
    began = time.process_time()
    result = call()
    return time.process_time() - began, result


def reference(scene: Scene, seed: int) -> pd.DataFrame:
    """Means, sds and their standard errors from exact flights: one row per impact and quantity."""
    run = simulate(scene, paths=PATHS, impacts=IMPACTS, scheme="exact-flight", rng=seed, workers=1)
    rows = []
    for impact, row in run.section.iterrows():
        for q in section_names(scene.stages):
            found = {
                "mean": row[q],
                "se_mean": row[f"se_{q}"],
                "sd": row[f"sd_{q}"],
                "se_sd": row[f"se_sd_{q}"],
            }
            rows.append({"impact": impact, "quantity": q, **found})
    return pd.DataFrame(rows)


def compared(scene: Scene, truth: pd.DataFrame) -> dict[str, float]:
    """One noise: worst errors of the closure, how right its estimates are, and what both sides
    cost."""
    seconds, m = spent(
        lambda: mean_map(scene, impacts=IMPACTS, closure="branching", tolerance=TOLERANCE)
    )
    truth = truth.copy()
    truth["struck"] = [
        q == f"x{m.section['mesh'].loc[k]}"
        for k, q in zip(truth.impact, truth.quantity, strict=True)
    ]
    truth = truth[~truth["struck"] & (truth["impact"] <= m.trace.found)]
    found = {"noise": scene.sigma / scene.alpha**0.5, "stages": scene.stages}
    counts = dict.fromkeys(("rows", "exceeded", "factor", "wrong", "marked", "unmarked"), 0)
    for name, limit in (("mean", TOLERANCE), ("sd", 2.0 * TOLERANCE)):
        prefix = "" if name == "mean" else "sd_"
        own = np.array(
            [
                m.section[f"{prefix}{q}"].loc[k]
                for k, q in zip(truth.impact, truth.quantity, strict=True)
            ]
        )
        error = (own - truth[name]).abs() / truth.sd
        se = truth[f"se_{name}"] / truth.sd
        by = pd.DataFrame({"impact": truth.impact, "error": error, "se": se}).groupby("impact")
        worst = by["error"].max()
        slack = LEEWAY * by["se"].max()
        said = m.section[f"error_{name}"].reindex(worst.index)
        wrong = worst - slack > limit
        marked = said > limit
        counts["rows"] += len(worst)
        counts["exceeded"] += int((worst > said + slack).sum())
        counts["factor"] += int(
            ((worst <= 2.0 * said + slack) & (worst >= 0.5 * said - slack)).sum()
        )
        counts["wrong"] += int(wrong.sum())
        counts["marked"] += int(marked.sum())
        counts["unmarked"] += int((wrong & ~marked).sum())
        found |= {
            f"error_{name}": worst.max(),
            f"se_{name}": by["se"].max().max(),
            f"bound_{name}": said.max(),
        }
    found |= counts
    few, many = (
        spent(
            lambda n=n: simulate(
                scene, paths=n, impacts=IMPACTS, scheme="exact-flight", rng=1, workers=1
            )
        )[0]
        for n in TIMED
    )
    each = (many - few) / (TIMED[1] - TIMED[0])
    own = max(found["error_mean"], found["error_sd"])
    se = max(found["se_mean"], found["se_sd"])
    # the accuracy of the reference: what no row is off by more than
    every = widest(2 * len(truth)) * se
    paths = (every / max(own, se)) ** 2 * PATHS
    found |= {"work": m.trace.work, "seconds": seconds}
    found |= {
        "path_seconds": each,
        "ratio": (each * paths) / seconds,
        "resolved": own > LEEWAY * se,
    }
    return found | {"advice": "simulate" if m.advice.endswith("simulate") else "branching"}


def table(found: pd.DataFrame) -> Table:
    """Errors of `branching`, its own bounds of them, and the time beside exact flights."""
    noises = found.groupby(["seen", "noise"])
    both = found.assign(noise="all").groupby(["seen", "noise"])
    rows = [row(seen, noise, of) for (seen, noise), of in [*noises, *both]]
    return list(rows[0]), [list(cells.values()) for cells in rows]


def row(seen: bool, noise: float | str, of: pd.DataFrame) -> dict[str, str]:
    """What the page shows of some gear sets at one noise, or at all."""
    used = of[of["advice"] == "branching"]["ratio"]

    def part(column: str, suffix: str = "") -> str:
        return f"{of[column + suffix].sum() / of['rows' + suffix].sum():.1%}"

    return {
        "gear sets": "for tuning" if seen else "unseen",
        "σ/√α": short(noise),
        "worst mean: median / largest": median_and_most(of["error_mean"]),
        "worst sd": median_and_most(of["error_sd"]),
        "beyond the bound": part("exceeded"),
        "within a factor of 2": part("factor"),
        "wrong": part("wrong"),
        "wrong, unmarked": part("unmarked"),
        "before: beyond the bound": part("exceeded", "_before"),
        "before: wrong": part("wrong", "_before"),
        "before: wrong, unmarked": part("unmarked", "_before"),
        "advised": f"{len(used)} of {len(of)}",
        "speed-up: least / median": (
            f"{short(used.min(), 2)} / {short(used.median(), 2)}" if len(used) else "–"
        ),
    }


def put_together(folder: Path, before: Path) -> None:
    """Write docs/results/branching.csv."""
    found, old = (
        pd.concat([pd.read_csv(f / f"errors_{i}.csv") for i in range(SETS)], ignore_index=True)
        for f in (folder, before)
    )
    for column in ("rows", "exceeded", "wrong", "unmarked"):
        found[f"{column}_before"] = old[column]
    found["reference"] = PATHS
    keep(found, TABLE, table, None)


def main(what: str, folder: Path, first: int, last: int) -> None:
    """Write the tables of some gear sets."""
    gears = gear_sets(sets=SETS)
    for i in range(first, last):
        lines = []
        if what == "errors":  # load the compiled code before anything is timed
            compared(noisy(gears[i], NOISE[0]), pd.read_csv(folder / f"{i}_{NOISE[0]:g}.csv"))
        for noise in NOISE:
            scene = noisy(gears[i], noise)
            to = folder / f"{i}_{noise:g}.csv"
            if what == "reference" and not to.exists():
                reference(scene, 100 + i).to_csv(to, index=False, float_format="%.12g")
            elif what == "errors":
                lines.append(
                    {"gears": i + 1, "seen": i < TUNED, **compared(scene, pd.read_csv(to))}
                )
                pd.DataFrame(lines).to_csv(
                    folder / f"errors_{i}.csv", index=False, float_format="%.4g"
                )


if __name__ == "__main__":
    if sys.argv[1] == "table":
        put_together(Path(sys.argv[2]), Path(sys.argv[3]))
    else:
        main(sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]))
