"""Strategies over invalid input: wrong values, damaged texts, damaged bytes, wrong commands."""

import math
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
from fuzz_space import scenes
from hypothesis import strategies as st

__all__ = ["STUDY", "commands", "settings_of", "spoilt_bytes", "spoilt_scenes", "spoilt_texts"]

nonsense = st.sampled_from([
    math.nan, math.inf, -math.inf, "abc", "", "0.5", "é\x00", b"x", 1j, [], [0.5], [[0.5]], {}, {"a": 0.5}, (), True,
    False, Decimal("0.5"), np.array([0.5, 0.6]), np.array([]), np.float32("nan"), object, 10**400, -(10**400), 10**5000,
    "x" * 10_000,
])  # fmt: skip
"""No number, name or table that anything here takes."""

doubtful = st.sampled_from([
    None, 0, 1, -1, 3, 0.5, 1.5, -0.5, -1e-300, 5e-324, 1e-31, 1e7, 1e200, 1e308, 10**30, 2**63, 2**64, Fraction(1, 3),
    np.float32(0.5), np.int64(1), 0.0, -0.0,
])  # fmt: skip
"""Numbers that one field takes and another does not."""

bad_values = st.one_of(nonsense, doubtful)

FIELDS = {
    "scene": ("alpha", "epsilon", "beta1", "beta2", "gamma1", "gamma2", "mu", "gap1", "gap2", "sigma", "stages"),
    "start": ("tau", "x1", "y1", "x2", "y2", "mesh"),
    "tolerance": ("c1_max", "c2_max", "distribution", "draw"),
    "gears": ("alpha", "epsilon", "omega", "inertia1", "radius2", "backlash1", "damping2", "torque1"),
}


@st.composite
def spoilt_scenes(draw: st.DrawFn) -> tuple[dict[str, Any], str]:
    """A scene with one thing wrong or doubtful in it, and the name of that."""
    data = draw(scenes())
    part = draw(st.sampled_from([*FIELDS, "key", "table"]))
    if part == "table":
        name = draw(st.sampled_from(["scene", "start", "tolerance", "gears"]))
        (data if name in ("scene", "gears") else data["scene"])[name] = draw(bad_values)
        return data, name
    if part == "key":
        name = draw(st.sampled_from(["alhpa", "x" * 5000, "", "é", 5]))
        draw(st.sampled_from([data, data["scene"]]))[name] = 1.0
        return data, ""
    name = draw(st.sampled_from(FIELDS[part]))
    if part == "gears":
        table = data.setdefault("gears", {})
    elif part == "scene":
        table = data["scene"]
    else:
        table = data["scene"].setdefault(part, {})
    table[name] = draw(bad_values)
    return data, name


KEYWORDS = {
    "mean_map": ("impacts", "closure", "order"),
    "simulate": (
        "paths", "impacts", "dt", "scheme", "rng", "workers", "times", "itineraries", "increments", "horizon", "device",
    ),
    "simulate_to": ("accuracy", "impacts", "scheme", "rng", "workers", "budget"),
    "validate": ("impacts", "closures", "paths", "dt", "scheme", "rng", "workers", "order"),
    "with_sigma": ("sigma",),
    "from_toml": ("text",), "load": ("path",), "from_dict": ("data",), "study": ("path",), "study_text": ("text",),
    "tables": ("path",), "at_times": ("times",), "density": ("impact", "quantity"),
    "edgeworth": ("impact", "stage"),
}  # fmt: skip
"""Settings of each entry point."""

settings_of = st.sampled_from([(f, k) for f, ks in KEYWORDS.items() for k in ks]).flatmap(
    lambda place: bad_values.map(lambda value: (*place, value))
)
"""A function, one of its settings, and a bad value of it."""

STUDY = """
[study]
impacts = 1
closures = ["saltation", "corrected"]
paths = 64
seed = 3
within = { mean = 0.05, sd = 0.1 }

[scene]
alpha = 1.5
epsilon = 0.9
beta1 = 0.083
gamma1 = 0.057
stages = 1

[[axes]]
sigma = { log = [0.01, 0.1, 2] }

[[axes]]
gap1 = [0.4, 0.5]
"tolerance.c1_max" = [0.0, 0.01]
"""
TOKENS = (
    "nan", "inf", "-inf", "1e400", "-1", "0", "9" * 5000, "'x'", '"', "[", "]", "[[", "{", "}", "=", "\n", "[scene]\n",
    "true", "1979-05-27", "é", "\x00", "\ufeff", "[[axes]]\n", "[" * 3000, "a.b.c = 1\n", "1_0", "0x1F", "sigma = 1\n",
    "#", "paths = 1e9\n", "seed = [1]\n", "[1, 10, 1000000000]",
)  # fmt: skip


@st.composite
def spoilt_texts(draw: st.DrawFn, text: str) -> str:
    """A text with pieces cut, doubled, or put in."""
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.integers(0, len(text)))
        end = min(len(text), at + draw(st.integers(0, 12)))
        text = text[:at] + draw(st.sampled_from(("", text[at:end] * 2, *TOKENS))) + text[end:]
    return text


@st.composite
def spoilt_bytes(draw: st.DrawFn) -> list[tuple[str, float, int]]:
    """What to do to a file, as ``(how, where, with what)``: flip bits, cut it off, overwrite, insert, remove."""
    hows = st.sampled_from(["flip", "flip", "flip", "cut", "write", "insert", "remove"])
    return [
        (draw(hows), draw(st.floats(0.0, 1.0)), draw(st.integers(0, 255)))
        for _ in range(draw(st.sampled_from([1, 1, 1, 2, 8])))
    ]  # fmt: skip


OPTIONS: dict[str, dict[str, tuple[str, ...]]] = {
    "simulate": {
        "--paths": ("32", "0", "-1", "1e3", "x", "9" * 30), "--impacts": ("2", "0", "-3", "x", "9" * 20),
        "--sigma": ("0.1", "0", "-1", "nan", "inf", "1e200", "1e-300", ""),
        "--dt": ("0.001", "0", "-1", "nan", "10", "1e-300"),
        "--scheme": ("exact-flight", "euler-maruyama", "milstein", ""), "--seed": ("1", "-1", "9" * 40, "x"),
        "--workers": ("1", "0", "-2", "99999999"), "--out": ("{tmp}/s.csv", "{tmp}/no/s.csv"), "--json": (),
        "--budget": ("1", "nan", "-1"),
    },
    "study": {"--workers": ("0", "x"), "--explain": (), "--status": (), "--out": ("{tmp}/study.toml",)},
    "show": {"--width": ("0", "x", "-5", "80"), "--section": ("x", "")},
    "validate": {
        "--paths": ("0", "x"), "--impacts": ("0", "-1"), "--sigma": ("nan", "-1", "1e-300"), "--order": ("7", "-1"),
        "--validity": ("x", "1:0:3", "nan:1:2", "1:2:999999999", ":::"), "--closure": ("x", ""), "--workers": ("0",),
        "--validity-paths": ("0", "-1"), "--repeat": ("{tmp}/no.json", "{tmp}"), "--require": ("x",),
    },
    "order": {"--paths": ("0", "x"), "--impacts": ("0", "x"), "--sigma": ("nan", "-1", "1e9"), "--workers": ("0",)},
    "tradeoff": {"--accuracy": ("0", "nan"), "--budget": ("0", "nan"), "--sigma": ("0", "nan"), "--impacts": ("0",)},
    "chaos": {
        "--points": ("1", "x"), "--impacts": ("0", "x"), "--events": ("0",), "--width": ("0", "nan", "-1"),
        "--over": ("x", "2:1:3", "nan:1:2", "0:1:1", "0:1:999999999999", "1e-3:1e300:3"), "--field": ("x", "epsilon"),
    },
    "claims": {"--workers": ("0",), "--seed": ("-1",), "--nonsense": ()},
}  # fmt: skip
"""Options with values; but for the first three commands each value is refused, for their work takes minutes."""
FILES = ("{tmp}/scene.toml", "{tmp}/bad.toml", "{tmp}/study.toml", "{tmp}/none.toml", "{tmp}", "", "-")


@st.composite
def commands(draw: st.DrawFn) -> list[str]:
    """A command line; but for `simulate`, `study` and `show` one that has something wrong in it."""
    name = draw(st.sampled_from([*OPTIONS, "simulate", "simulate", "study", "show"]))
    words = [name]
    harmless = name in ("simulate", "study", "show")
    if draw(st.booleans()) or name in ("study", "show"):
        words.append(draw(st.sampled_from(FILES)))
    for option in draw(st.lists(st.sampled_from(sorted(OPTIONS[name])), min_size=0 if harmless else 1, max_size=3)):
        values = OPTIONS[name][option]
        words += [option, *([draw(st.sampled_from(values))] if values else [])]
    if name == "simulate":
        words += ["--paths", "16", "--impacts", "1"] if not {"--paths", "--impacts"} & set(words) else []
    if name == "study" and not {"--explain", "--status"} & set(words):
        words.append("--explain")
    return words
