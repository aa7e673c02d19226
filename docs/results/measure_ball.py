"""How far closures are accurate for a ball under gravity and white noise, against its exact
density: docs/results/ball.csv.

``python docs/results/measure_ball.py`` (seconds; nothing is sampled).
"""

from pathlib import Path

import pandas as pd
from kept_tables import Table, keep, short

from rattle import mean_map
from rattle.compare.checks.published.bodies import MOMENTS, ball, exact_impacts

TABLE = Path(__file__).parent / "ball.csv"
RESTITUTIONS = (0.5, 0.8, 0.9)
LAUNCHES = (1.0, 3.0, 10.0, 30.0)
"""First launch speeds, in sigma^2 / g: a fast ball hardly feels the noise."""
CLOSURES = {"saltation, first order": 2, "saltation": 4, "branching": 4}
"""Closures and the order up to which their moments go."""
IMPACTS = 4
# largest error of a mean in sds, and of an sd, that is accurate: those of a verdict
MEAN_ALLOWED = 0.05
SD_ALLOWED = 0.10


def measure() -> pd.DataFrame:
    """Errors of all closures at the first impacts."""
    rows = []
    for restitution in RESTITUTIONS:
        for launch in LAUNCHES:
            exact = exact_impacts(restitution, launch).section
            for closure, order in CLOSURES.items():
                name = closure.split(",")[0]
                scene = ball(restitution, launch)
                section = mean_map(scene, impacts=IMPACTS, closure=name, order=order).section
                for impact in range(1, IMPACTS + 1):
                    row = {"epsilon": restitution, "launch": launch, "closure": closure}
                    row["impact"] = impact
                    for column in MOMENTS:
                        truth = exact[column][impact - 1]
                        found = section[column].get(impact, float("nan"))
                        is_sd = column.startswith("sd_")
                        size = truth if is_sd else exact[f"sd_{column}"][impact - 1]
                        row[column] = (found - truth) / size
                    rows.append(row)
    return pd.DataFrame(rows)


def _is_accurate(errors: pd.DataFrame) -> pd.Series:
    """Whether all moments of an impact are accurate."""
    means = errors[["flight", "y1"]].abs().max(axis=1) <= MEAN_ALLOWED
    sds = errors[["sd_flight", "sd_y1"]].abs().max(axis=1) <= SD_ALLOWED
    return means & sds


def table(found: pd.DataFrame) -> Table:
    """The impacts up to which each closure is accurate, and its errors at the first one."""
    rows = []
    for (restitution, launch), of in found.groupby(["epsilon", "launch"], sort=False):
        row = [short(restitution), short(launch)]
        for closure in CLOSURES:
            errors = of[of["closure"] == closure]
            good = int(_is_accurate(errors).cummin().sum())
            first = errors.iloc[0]
            row.append(f"{good} ({first['sd_flight']:+.1%}, {first['sd_y1']:+.1%})")
        rows.append(row)
    return ["ε", "u g / σ²", *CLOSURES], rows


if __name__ == "__main__":
    keep(measure(), TABLE, table)
