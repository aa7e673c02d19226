"""Which entry points are tried, with which settings, and how long one may take."""

from typing import Any

from fuzz_space import scenes
from hypothesis import strategies as st

__all__ = ["BOUNDS", "PLAN", "SIMPLE", "examples", "warm_up"]

BOUNDS = {"validate": 300.0, "validate a file": 300.0, "study a file": 300.0}
"""Seconds that one answer may take, if not 60.

`validate` abandons paths after ten million steps, which take 72 s for 64 sticking paths, and makes a pilot run.
"""

SIMPLE: dict[str, Any] = {
    "scene": {
        "alpha": 1.5, "epsilon": 0.9, "beta1": 0.083, "beta2": 0.133, "gamma1": 0.057, "gamma2": 0.029, "mu": 0.6,
        "sigma": 0.1, "tolerance": {"c1_max": 0.01, "c2_max": 0.01},
    }
}  # fmt: skip

_closure = st.fixed_dictionaries({"impacts": st.just(3), "order": st.sampled_from([2, 4, 6])})
_run = {"paths": st.sampled_from([2, 8]), "impacts": st.just(2), "horizon": st.just(20.0), "rng": st.integers(0, 2**40)}
_times = st.sampled_from([(), (0.5,), (0.2, 10.0)])
_euler = st.fixed_dictionaries(
    _run | {"dt": st.just(0.002), "step_bias": st.booleans(), "increments": st.sampled_from(["gaussian", "two-point"])}
)
PLAN: dict[str, st.SearchStrategy[dict[str, Any]]] = {
    "scene": st.just({}),
    "orbit": st.fixed_dictionaries({"impacts": st.sampled_from([1, 5, 30])}),
    "long orbit": st.fixed_dictionaries({"impacts": st.sampled_from([1, 20]), "start": st.integers(0, 3)}),
    "published": _closure, "corrected": _closure, "saltation": _closure,
    "branching": st.just({"impacts": 2}),
    "euler-maruyama": _euler, "euler-maruyama-located": _euler,
    "exact-flight": st.fixed_dictionaries(
        _run | {"dt": st.just(0.01), "control": st.booleans(), "energy": st.booleans(), "times": _times}
    ),
    "validate": st.just({"impacts": 2, "paths": 64, "scheme": "exact-flight"}),
}  # fmt: skip
"""Settings of each entry point that takes a scene."""


@st.composite
def examples(draw: st.DrawFn, entry: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """A scene and settings for an entry point; some simulations have more paths than a block."""
    data, settings = draw(scenes()), draw(PLAN[entry])
    if "paths" in settings and entry != "validate" and draw(st.integers(0, 19)) == 19:
        settings = settings | {"paths": 1030}  # then one worker is compared with two
    return data, settings


def warm_up(*entries: str) -> list[tuple[Any, ...]]:
    """Jobs that compile what these entry points need."""
    few: dict[str, Any] = {"paths": 2, "impacts": 1, "horizon": 1.0, "dt": 0.002}
    settings: dict[str, dict[str, Any]] = {
        "euler-maruyama": few | {"step_bias": True}, "euler-maruyama-located": few | {"step_bias": True},
        "exact-flight": few | {"control": True}, "long orbit": {"impacts": 1},
        "validate": {"impacts": 1, "paths": 64, "scheme": "exact-flight"},
    }  # fmt: skip
    return [(e, SIMPLE, settings.get(e, {"impacts": 1})) for e in entries if e in PLAN]
