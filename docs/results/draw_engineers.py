"""Draw ten gear sets at random, with values in published ranges.

``python docs/results/draw_engineers.py`` writes docs/results/engineers/random-tuned-*.toml, sets on
which defaults of the commands may be tuned, and random-unseen-*.toml, which are measured at the end
alone.
"""

import math
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).parent / "engineers"
SEED = 1946
SETS = 10
TUNED = 5  # the first of them
SINGLE = (3, 8)  # sets with one loose wheel
STEEL = 7.8e-6  # kg / mm^3
MILLI = 1e-3  # N of kg mm/s^2


def draw_set(number: int) -> dict[str, dict[str, float]]:
    """The tables of a file of gears."""
    rng = np.random.default_rng([SEED, number])

    def uniform(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    def log_uniform(low: float, high: float) -> float:
        return math.exp(uniform(math.log(low), math.log(high)))

    omega = log_uniform(80.0, 1500.0)  # rad/s: 13 to 240 excitations a second
    backlash = uniform(0.05, 0.3)
    alpha = log_uniform(0.4, 5.0)  # amplitude of the driver over the backlash
    radius = uniform(25.0, 80.0)
    drag = log_uniform(0.04, 1.0)  # over what the driver's acceleration exerts at most
    gears = {
        "amplitude": alpha * backlash,
        "omega": omega,
        "epsilon": uniform(0.3, 0.8),
    }
    wheels = 1 if number in SINGLE else 2
    for wheel in range(1, wheels + 1):
        width = uniform(10.0, 30.0)
        inertia = 0.5 * math.pi * STEEL * width * radius**4
        gears[f"inertia{wheel}"] = inertia
        gears[f"radius{wheel}"] = radius
        gears[f"backlash{wheel}"] = backlash
        gears[f"damping{wheel}"] = MILLI * log_uniform(0.002, 0.1) * inertia * omega
        acceleration = drag * gears["amplitude"] * omega**2
        gears[f"torque{wheel}"] = MILLI * acceleration * inertia / radius
        radius *= uniform(0.6, 1.0)
        backlash = uniform(0.05, 0.3)
        drag *= uniform(0.5, 1.2)
    sigma = alpha * log_uniform(0.01, 0.08)
    scene = {"sigma": sigma} | ({"stages": 1} if wheels == 1 else {})
    return {"gears": gears, "scene": scene}


def write(number: int) -> None:
    """Write the file of a set, with three digits, as one types."""
    kind = "tuned" if number < TUNED else "unseen"
    lines = [f"# Drawn at random: set {number} of docs/results/draw_engineers.py"]
    for table, values in draw_set(number).items():
        lines.append(f"[{table}]")
        lines += [f"{name} = {float(f'{value:.3g}'):g}" for name, value in values.items()]
    (FOLDER / f"random-{kind}-{number}.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    for number in range(SETS):
        write(number)
