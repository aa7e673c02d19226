"""How far stochastic averaging holds for an oscillator under white noise with a wall in its middle:
docs/results/oscillator.csv.

``python docs/results/measure_oscillator.py`` (two minutes on two cores).  Speeds are in proportion
to the noise, so that damping and restitution are all there is to vary.
"""

import math
from pathlib import Path

import pandas as pd
from kept_tables import Table, keep, short

from rattle import Scene, Start, Wheel, stationary

TABLE = Path(__file__).parent / "oscillator.csv"
DAMPINGS = (0.01, 0.05, 0.2)
"""Damping ratios zeta."""
RESTITUTIONS = (1.0, 0.95, 0.8, 0.5)
SIGMA = 0.3
ACCURACY = 0.005
ALLOWED = 0.05
"""Relative error that is accurate."""
QUANTITIES = ("rate", "speed", "rms_speed")


def averaged(zeta: float, restitution: float) -> dict[str, float]:
    """What stochastic averaging after Zhuravlev's transformation says: rate, mean and root mean
    square of the impact speed.

    With ``x = -|z|`` the wall is gone, and what impacts lose is spread over the time between them:
    the mean energy obeys ``H' = sigma^2 / 2 - (2 zeta + (1 - restitution^2) / pi) H``, its
    stationary distribution is exponential, and the wall is struck once in half a period
    (Dimentberg and Iourtchenko 2004).
    """
    loss = 2.0 * zeta + (1.0 - restitution**2) / math.pi
    energy = 0.5 * SIGMA**2 / loss
    return {
        "rate": 1.0 / math.pi,
        "speed": math.sqrt(0.5 * math.pi * energy),
        "rms_speed": math.sqrt(2.0 * energy),
    }


def oscillator(zeta: float, restitution: float) -> Scene:
    """An oscillator of frequency 1 with a wall in its middle."""
    mass = Wheel(beta=2.0 * zeta, stiffness=1.0, gap=0.0, one_sided=True, name="mass")
    return Scene(
        alpha=0.0,
        epsilon=restitution,
        sigma=SIGMA,
        noise="mass",
        wheels=[mass],
        start=Start(0.0, state=(0.0, -SIGMA)),
    )


def measure() -> pd.DataFrame:
    """The long run of each oscillator, with the error of each quantity."""
    rows = []
    for zeta in DAMPINGS:
        for restitution in RESTITUTIONS:
            run = stationary(
                oscillator(zeta, restitution), accuracy=ACCURACY, rng=1, workers=2, slow=0.01
            ).table
            row = {"zeta": zeta, "epsilon": restitution}
            for name, predicted in averaged(zeta, restitution).items():
                low, high = run.loc[name, ["low", "high"]]
                row[name] = run.loc[name, "value"]
                # of the prediction, relative; its interval from that of the run
                row[f"low_{name}"] = predicted / high - 1.0
                row[f"high_{name}"] = predicted / low - 1.0
            rows.append(row)
    return pd.DataFrame(rows)


def _verdict(low: float, high: float) -> str:
    """What the interval of an error says."""
    if max(abs(low), abs(high)) <= ALLOWED:
        return "accurate"
    if low > ALLOWED or high < -ALLOWED:
        return "inaccurate"
    return "undecided"


def table(found: pd.DataFrame) -> Table:
    """The error of each quantity with its verdict."""
    rows = []
    for row in found.to_dict("records"):
        cells = [short(row["zeta"]), short(row["epsilon"])]
        for name in QUANTITIES:
            low = row[f"low_{name}"]
            high = row[f"high_{name}"]
            cells.append(f"{low:+.1%} to {high:+.1%}: {_verdict(low, high)}")
        rows.append(cells)
    heads = ["impacts per time", "mean impact speed", "root mean square impact speed"]
    return ["ζ", "ε", *heads], rows


if __name__ == "__main__":
    keep(measure(), TABLE, table)
