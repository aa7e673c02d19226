"""A strategy over all that a scene may be: plain data, as a caller or a file would give it.

Every scene is drawn field by field, each either near the paper's example or anywhere in its range (log-uniform, with
the values that break things: zero, the ends of the range, equal dampings, restitution 0 and 1), so that wild fields
meet tame ones.
"""

import math
from typing import Any

from hypothesis import strategies as st

__all__ = ["scenes"]

TINY = (1e-30, 1e-30, 1e-20, 1e-16, 1e-12)
Data = dict[str, Any]


def over(low: float, high: float, *special: float) -> st.SearchStrategy[float]:
    """Log-uniform numbers, now and then one of the special ones."""
    ends = math.log10(low), math.log10(high)
    spread = st.floats(*ends).map(lambda e: min(max(10.0**e, low), high))
    return st.one_of(spread, spread, st.sampled_from(special)) if special else spread


def either(tame: st.SearchStrategy[float], wild: st.SearchStrategy[float]) -> st.SearchStrategy[float]:
    """Tame twice in three times."""
    return st.one_of(tame, tame, wild)


ALPHA = either(over(0.3, 3.0, 1.5, 0.0), over(1e-12, 1e4, *TINY, 1e6))
EPSILON = either(st.sampled_from([0.9, 0.5, 0.7]), st.one_of(over(1e-3, 1.0), st.sampled_from(
    [0.0, 1.0, 0.163, 5e-324, 1e-12, 1.0 - 2.0**-53]
)))  # fmt: skip
BETA = either(over(0.03, 0.3, 0.0), over(1e-12, 1e3, *TINY, 5e-324, 1e4))
GAMMA = either(over(0.02, 0.2, 0.0), over(1e-12, 1e4, *TINY, 1e6))
GAP = either(over(0.2, 2.0, 0.5), over(1e-8, 1e4, 1e-9, 1e6))
SIGMA = either(over(1e-3, 2.0, 0.0), over(1e-12, 1e4, *TINY, 1e6))
MU = either(st.sampled_from([0.6, 0.2]), st.one_of(
    over(1e-12, 0.999), st.sampled_from([1e-30, 1e-12, 0.5, 1.0 - 2.0**-53])
))  # fmt: skip
SPEED = either(over(0.1, 5.0, 2.0), over(1e-12, 1e4, *TINY, 5e-324, 1e6))
SIGN = st.sampled_from([1.0, -1.0])
TAU = either(st.floats(-10.0, 10.0), st.sampled_from([0.0, -0.0, 1e-300, 1e3, 1e6, 1e9, 1e12, -1e12]))


@st.composite
def tolerances(draw: st.DrawFn, gap1: float, gap2: float) -> Data:
    """A tolerance that leaves both gaps open."""
    deviation = st.sampled_from([0.0, 0.01, 0.1, 0.5, 1.0 - 2.0**-53, 1e-12, 1e-20])
    return {
        "c1_max": draw(deviation) * gap1,
        "c2_max": draw(deviation) * gap2,
        "distribution": draw(st.sampled_from(["fixed", "uniform", "normal"])),
        "draw": draw(st.sampled_from(["path", "contact"])),
    }


@st.composite
def starts(draw: st.DrawFn, stages: int, gaps: tuple[float, float], c_max: tuple[float, float]) -> Data:
    """A start on a flank, inside, with zero velocity, or with both meshes struck at once."""
    mesh = draw(st.integers(0, stages))
    start: Data = {"tau": draw(TAU), "mesh": mesh}
    for i in (1, 2):
        gap, free = gaps[i - 1], gaps[i - 1] - c_max[i - 1]
        side, speed = draw(SIGN), draw(SPEED)
        where = "struck" if mesh == i else draw(st.sampled_from(["inside", "rest", "inward", "edge", "struck"]))
        x, y = gap * side, speed * side
        if where == "inside":
            x, y = draw(st.sampled_from([0.0, 0.3, 0.999, 1.0 - 1e-15])) * free * side, speed * draw(SIGN)
        elif where == "rest":
            x, y = draw(st.sampled_from([0.0, 0.5, 1.0 - 1e-12])) * free * side, 0.0
        elif where == "edge":
            x, y = free * side, -speed * side
        elif where == "inward" or (mesh == 0 and i <= stages):
            y = -speed * side
        start |= {f"x{i}": x, f"y{i}": y}
    return start


@st.composite
def gears(draw: st.DrawFn) -> Data:
    """A gear pair in workshop units."""
    size = either(over(0.2, 5.0, 1.0), over(1e-3, 1e3))
    middle = {
        "omega": 300.0, "inertia1": 4000.0, "inertia2": 2500.0, "radius1": 41.0, "radius2": 26.4, "backlash1": 0.2,
        "backlash2": 0.2, "damping1": 100.0, "damping2": 100.0, "torque1": 100.0, "torque2": 50.0,
    }  # fmt: skip
    return {"alpha": draw(ALPHA), "epsilon": draw(EPSILON)} | {k: v * draw(size) for k, v in middle.items()}


@st.composite
def scenes(draw: st.DrawFn, stages: int | None = None) -> Data:
    """A scene in the form of `Scene.from_dict`; nearly all of them pass input validation."""
    stages = draw(st.sampled_from([2, 2, 1])) if stages is None else stages
    scene: Data = {"sigma": draw(SIGMA), "stages": stages}
    data: Data = {"scene": scene}
    if draw(st.integers(0, 9)) == 9:
        data["gears"] = pair = draw(gears())
        gaps = 0.5, pair["backlash2"] / (2.0 * pair["backlash1"])
    else:
        scene |= {"alpha": draw(ALPHA), "epsilon": draw(EPSILON), "beta1": draw(BETA), "gamma1": draw(GAMMA)}
        scene["gap1"] = draw(GAP)
        beta1, gap1 = scene["beta1"], scene["gap1"]
        equal = st.sampled_from([beta1, beta1 * (1.0 + 2.0**-52)])
        scene["beta2"] = draw(st.one_of(BETA, BETA, equal))
        scene["gamma2"] = draw(st.one_of(GAMMA, GAMMA, st.just(scene["gamma1"])))
        scene["gap2"] = draw(st.one_of(GAP, GAP, st.just(gap1)))
        scene["mu"] = draw(MU)
        gaps = gap1, scene["gap2"]
    c_max = 0.0, 0.0
    if draw(st.integers(0, 2)) == 0:
        scene["tolerance"] = draw(tolerances(*gaps))
        c_max = scene["tolerance"]["c1_max"], scene["tolerance"]["c2_max"]
    if draw(st.booleans()):
        scene["start"] = draw(starts(stages, gaps, c_max))
    return data
