"""Which entry points are tried, how often, and with which settings: small work mostly, much of it
rarely."""

from collections.abc import Callable
from itertools import accumulate
from typing import NamedTuple

from fuzz_space import LEAST, Numbers, any_scene

from rattle import Scene
from rattle.montecarlo import SCHEMES, default_step, largest_step
from rattle.scene import RattleError

WORK = 1e6  # steps of all paths
HORIZON_PER_IMPACT = 50.0  # time and steps after which a path is given up by default
DEFAULT_STEPS = 10**7
# steps of the default horizon above which entries without another horizon are tried rarely
SOON = 1e5
CODES = {1: (1, -1), 2: (1, -1, 2, -2)}  # of impacts, by number of wheels


def built(data):
    """The scene, if it is one."""
    try:
        return Scene.from_dict(data)
    except RattleError:
        return None


def _closure(n, scene):
    return {"impacts": n.count(64), "order": n.one(2, 3, 4, 5, 6)}


def _run(scheme):
    exact = not SCHEMES[scheme].has_step_bias

    def settings(n, scene):
        biased = not exact and n.often(0.3)
        paths = n.one(1, 2, 3, 31, 33, 31, 33, 1000, 1030)
        impacts = n.count(64)
        longest = largest_step(scene, scheme)[0] / (4 if biased else 1)
        shorter = max(longest * n.size(n.one(1e-3, 1e-3, 1e-6), 1.0, False), LEAST)
        dt = n.one(None, shorter)
        step = default_step(scene, scheme, biased) if dt is None else dt
        horizon = step * n.size(1.0, WORK / paths, False)
        recorded = ("histogram", "batches", "energy")
        out = {name: n.often(0.3) for name in recorded} | {"step_bias": biased}
        coarsest = 4.0 * step if biased else step
        if n.often(0.3) and horizon > coarsest:
            since = [n.size(coarsest, horizon, False) for _ in range(n.one(1, 3))]
            out["times"] = tuple(scene.start.tau + t for t in since)
        if exact:
            out["control"] = n.often(0.25)
        else:
            out["increments"] = n.one("gaussian", "two-point")
        if n.often(0.2):
            codes = CODES[scene.stages]
            out["itineraries"] = {"mine": tuple(n.one(*codes) for _ in range(impacts))}
        own = {"paths": paths, "impacts": impacts, "dt": dt, "rng": n.seed(), "horizon": horizon}
        return out | own

    return settings


def _accuracy(n, scene):
    return {
        "impacts": n.one(1, 1, 2, n.count(64)),
        "accuracy": n.size(1e-9, 0.9, False),
        "budget": n.size(1e-2, 0.3, False),
        "scheme": n.one(None, None, *SCHEMES),
        "rng": n.seed(),
        "batches": n.often(0.3),
        "energy": n.often(0.3),
    }


def _validation(n, scene):
    return {
        "impacts": n.one(1, 2, 3, n.count(12)),
        "paths": n.one(1, 2, 3, 31, 33, 64),
        "scheme": n.one("exact-flight", "exact-flight", *SCHEMES),
        "order": n.one(2, 3, 4, 5, 6),
        "rng": n.seed(),
    }


def _report(n, scene):
    return {"impacts": n.one(1, 2), "paths": n.one(2, 33), "seed": n.seed()}


def _study(n, scene):
    """A study over the noise and another field."""
    closures = n.one(["saltation"], ["published", "branching", "corrected"])
    study = {"impacts": n.one(1, 2, 3), "order": n.one(2, 4, 6), "paths": 64, "closures": closures}
    sigmas = sorted({0.0, scene.sigma, n.size(1e-30, 1e6, False)})
    return {"study": study, "axes": [{"sigma": sigmas}, {n.one("epsilon", "start.tau"): [0.25]}]}


def _soon(scene):
    """Whether the default horizon of a scene has few steps."""
    return min(HORIZON_PER_IMPACT / default_step(scene, "exact-flight"), DEFAULT_STEPS) < SOON


class Tried(NamedTuple):
    """How often an entry point is tried, of `sum` of all, with which settings, and whether it waits
    for the horizon."""

    share: float
    settings: Callable
    waits: bool = False


PLAN = {
    "scene": Tried(8, lambda n, scene: {}),
    "orbit": Tried(12, lambda n, scene: {"impacts": n.count(1000)}),
    "long orbit": Tried(6, lambda n, scene: {"impacts": n.count(64), "start": n.one(0, 1, 2, 3)}),
    "published": Tried(8, _closure),
    "corrected": Tried(8, _closure),
    "saltation": Tried(10, _closure),
    "branching": Tried(
        3, lambda n, scene: {"impacts": n.one(1, 2, 3), "order": n.one(2, 3, 4, 5, 6)}
    ),
    "euler-maruyama": Tried(10, _run("euler-maruyama")),
    "euler-maruyama-located": Tried(10, _run("euler-maruyama-located")),
    "exact-flight": Tried(14, _run("exact-flight")),
    "accuracy": Tried(4, _accuracy),
    "validate": Tried(1.5, _validation, waits=True),
    "validate a file": Tried(0.2, _report, waits=True),
    "study a file": Tried(0.5, _study, waits=True),
}
"""Every entry point: the API, scene files, the command line, studies; the last two read back what
was written."""

_EDGES = list(accumulate(tried.share for tried in PLAN.values()))


def job(seed, number, entry=""):
    """The scene of this number, with an entry point and settings; always the same for the same
    seed."""
    n = Numbers(seed, number)
    at = n.stream.random() * _EDGES[-1]
    drawn = next(name for name, edge in zip(PLAN, _EDGES, strict=True) if at <= edge)
    entry = entry or drawn
    for _ in range(20):
        data = any_scene(n)
        scene = built(data)
        if scene is None or not PLAN[entry].waits or _soon(scene) or n.often(0.01):
            break
    return entry, data, PLAN[entry].settings(n, scene) if scene else {"impacts": 1}
