"""Scenes of every magnitude, log-uniform over the whole admissible range, with weight on its ends.

Numbers come from a stream of numpy's Philox, so that a job is a function of the seed and of its own
number.  A third of the scenes draw each field by itself, over all decades; a third draw lengths
around one unit of any size, so that something happens in them; a third are near the paper's
example.
"""

import math

import numpy as np

LEAST = 5e-324
"""The least number above 0."""
# what is admissible, as test_fuzz_limits.py has it
LEAST_SIZE = 1e-30
GAPS = (1e-9, 1e6)
LARGEST = 1e6  # alpha, gamma, sigma and speeds
LARGEST_DAMPING = 1e4
LARGEST_TIME = 1e12
BELOW_ONE = 1.0 - 2.0**-53
SIZES = (1e-12, 1e12)  # of a gear


class Numbers:
    """What is drawn, one after the other."""

    def __init__(self, *key):
        self.stream = np.random.Generator(np.random.Philox(np.random.SeedSequence(key)))

    def often(self, share):
        """True in this share of the draws."""
        return bool(self.stream.random() < share)

    def one(self, *values):
        """One of some values; what is given twice comes twice as often."""
        return values[int(self.stream.integers(len(values)))]

    def size(self, least, most, zero=True):
        """Log-uniform between two ends; each end in one draw of twenty, 0 in one of ten where it is
        admissible.

        Where the least is the least of all floats, half of the draws keep to those that have a
        square.
        """
        if zero and self.often(0.1):
            return 0.0
        if self.often(0.1):
            return self.one(least, most)
        if least < LEAST_SIZE < most and self.often(0.5):
            least = LEAST_SIZE
        drawn = 10.0 ** self.stream.uniform(math.log10(least), math.log10(most))
        return float(np.clip(drawn, least, most))

    def count(self, most):
        """A log-uniform whole number from 1 on."""
        return min(int(self.size(1.0, most + 1.0, zero=False)), most)

    def signed(self, most):
        """A number of either sign, 0 among them."""
        return self.one(1.0, -1.0) * self.size(LEAST, most)

    def seed(self):
        """A seed."""
        return self.one(0, 1, 2**63, 2**128 - 1, int(self.stream.integers(2**62)))


class _Lengths:
    """Sizes of what is a length over a power of time: anywhere, or around one unit, near to it or
    far."""

    def __init__(self, numbers):
        self.numbers = numbers
        unit = numbers.size(*GAPS, zero=False)
        self.low, self.high = numbers.one((0.0, math.inf), (unit / 300.0, unit * 300.0), (0.1, 2.0))

    def size(self, least, most, zero=True):
        return self.numbers.size(max(least, self.low), min(most, self.high), zero)


def _share(n):
    """Between 0 and 1, ends included, as close to either as floats allow."""
    any_size = n.size(LEAST, 1.0)
    near_one = 1.0 - n.size(2.0**-53, 1.0)
    return n.one(
        0.0, 1.0, LEAST, BELOW_ONE, any_size, near_one, n.stream.random(), n.stream.random()
    )


def _plain(n, lengths, stages):
    damping = (1e-3, 10.0) if lengths.low else (LEAST, LARGEST_DAMPING)
    beta1 = n.size(*damping)
    scene = {
        "alpha": lengths.size(LEAST_SIZE, LARGEST),
        "epsilon": _share(n),
        "beta1": beta1,
        "gamma1": lengths.size(LEAST_SIZE, LARGEST),
        "gap1": lengths.size(*GAPS, zero=False),
    }
    if stages == 2 or n.often(0.2):
        other = n.size(*damping)
        next_one = min(math.nextafter(beta1, math.inf), LARGEST_DAMPING)
        other_gap = lengths.size(*GAPS, zero=False)
        near_one = 1.0 - n.size(2.0**-53, 0.5, zero=False)
        small = n.size(LEAST_SIZE, BELOW_ONE, zero=False)
        scene |= {
            "beta2": n.one(beta1, next_one, *[other] * 6),
            "gamma2": lengths.size(LEAST_SIZE, LARGEST),
            "gap2": n.one(scene["gap1"], *[other_gap] * 3),
            "mu": n.one(small, near_one, n.stream.uniform(0.1, 0.9)),
        }
    return scene


def _gears(n):
    """A gear pair of any size, dampings and drags up to those of a scene."""
    sizes = (1e-3, 1e3) if n.often(0.5) else SIZES
    names = ("omega", "inertia1", "inertia2", "radius1", "radius2", "backlash1", "backlash2")
    pair = {name: n.size(*sizes, zero=False) for name in names}
    for i in (1, 2):
        momentum = 1e-3 * pair[f"inertia{i}"] * pair["omega"]
        pair[f"damping{i}"] = momentum * n.size(1e-3, LARGEST_DAMPING)
        pair[f"torque{i}"] = momentum * pair["omega"] * n.size(1e-3, 1.0)
    return pair


def _deviation(n, gap):
    """0, the least, anything below the gap, or just under it."""
    under = math.nextafter(gap, 0.0)
    return n.one(
        0.0, LEAST_SIZE, under, 0.1 * gap, n.size(LEAST_SIZE, under), n.size(LEAST_SIZE, under)
    )


def _tolerance(n, gaps):
    return {
        "c1_max": _deviation(n, gaps[0]),
        "c2_max": _deviation(n, gaps[1]),
        "distribution": n.one("fixed", "uniform", "normal"),
        "draw": n.one("path", "contact"),
    }


def _start(n, lengths, stages, gaps, free):
    """At a mesh or in flight; with zero velocity, at an edge, in the middle; early, and as late as
    is admissible."""
    mesh = n.one(*range(stages + 1))
    tau = n.one(n.signed(LARGEST_TIME), n.stream.uniform(-10.0, 10.0))
    start = {"tau": tau, "mesh": mesh}
    for i, gap, room in zip((1, 2), gaps, free, strict=True):
        side = n.one(1.0, -1.0)
        speed = lengths.size(LEAST, LARGEST, zero=False)
        inside = room * n.size(1e-300, 1.0)
        x = n.one(gap, room, inside, inside, room * (1.0 - n.size(2.0**-53, 1.0)))
        y = n.one(0.0, speed, -speed)
        if mesh == i:
            x = gap
            y = speed
        elif mesh == 0 and x == gap:
            y = -speed
        start |= {f"x{i}": side * x, f"y{i}": side * y}
    return start


def any_scene(n):
    """A scene in the form of `Scene.from_dict`; nearly all of them pass input validation."""
    stages = n.one(2, 2, 1)
    lengths = _Lengths(n)
    scene = _plain(n, lengths, stages)
    data = {"scene": scene}
    gaps = scene["gap1"], scene.get("gap2", 0.5)
    if stages == 2 and n.often(0.1):
        pair = _gears(n)
        data = {"gears": pair | {name: scene[name] for name in ("alpha", "epsilon")}, "scene": {}}
        gaps = 0.5, pair["backlash2"] / (2.0 * pair["backlash1"])
    scene = data["scene"]
    scene["stages"] = stages
    scene["sigma"] = 0.0 if n.often(0.2) else lengths.size(LEAST_SIZE, LARGEST)
    deviations = (0.0, 0.0)
    if n.often(0.4):
        scene["tolerance"] = tolerance = _tolerance(n, gaps)
        deviations = tolerance["c1_max"], tolerance["c2_max"]
    if n.often(0.6):
        free = gaps[0] - deviations[0], gaps[1] - deviations[1]
        scene["start"] = _start(n, lengths, stages, gaps, free)
    return data
