"""Bad input leads to one of our errors that names it, or to an answer; a spoilt file is refused, or
read as written.

Scenes with one thing wrong in them, settings, texts and damaged files, always the same.
"""

import math
import tempfile
from decimal import Decimal
from fractions import Fraction
from functools import partial
from itertools import count

import numpy as np
import pandas as pd
import pytest
from commands import rattle, study
from fuzz_must import finite, refused
from fuzz_plan import built, job
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from settings import recorded

from rattle import validate
from rattle.closure import mean_map
from rattle.compare.cli.terminal import read_page
from rattle.compare.engine import store
from rattle.compare.report import manifest
from rattle.compare.study.design import Study
from rattle.compare.study.folder import load_study
from rattle.compare.thresholds.fixture import read_baseline
from rattle.montecarlo import simulate, simulate_to
from rattle.scene import DAT21, InputError, Scene
from rattle.scene.errors import RattleError

DAT = Scene.from_gears(DAT21, sigma=0.1)


def tried(**strategies):
    """A test of many inputs, always the same; how many is its argument ``inputs``."""
    inputs = strategies.pop("inputs")
    same = settings(
        derandomize=True,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        max_examples=inputs,
        suppress_health_check=list(HealthCheck),
    )
    return lambda test: pytest.mark.slow(same(given(**strategies)(test)))


BAD = st.sampled_from(
    [
        math.nan,
        math.inf,
        -math.inf,
        "abc",
        "",
        "0.5",
        "é\x00",
        b"x",
        1j,
        [],
        [0.5],
        [[0.5]],
        {},
        {"a": 0.5},
        (),
        True,
        Decimal("0.5"),
        np.array([0.5, 0.6]),
        np.array([]),
        np.float32("nan"),
        object,
        "x" * 10_000,
        None,
        0,
        1,
        -1,
        3,
        0.5,
        1.5,
        -0.5,
        -1e-300,
        5e-324,
        1e-31,
        1e7,
        1e200,
        10**30,
        2**63,
        Fraction(1, 3),
        -0.0,
    ]
)
"""What nothing here takes, and numbers that one field takes and another does not."""
FIELDS = {
    "scene": (
        "alpha",
        "epsilon",
        "beta1",
        "beta2",
        "gamma1",
        "gamma2",
        "mu",
        "gap1",
        "gap2",
        "sigma",
        "stages",
    ),
    "start": ("tau", "x1", "y1", "x2", "y2", "mesh"),
    "tolerance": ("c1_max", "c2_max", "distribution", "draw"),
    "gears": (
        "alpha",
        "epsilon",
        "omega",
        "inertia1",
        "radius2",
        "backlash1",
        "damping2",
        "torque1",
    ),
}


@st.composite
def spoilt_scenes(draw):
    """A scene with one thing wrong or doubtful in it, and the name of that."""
    drawn = draw(st.integers(0, 10**6))
    data = next(data for number in count(drawn) if built(data := job(1, number, "scene")[1]))
    part = draw(st.sampled_from([*FIELDS, "key", "table"]))
    if part == "key":
        draw(st.sampled_from([data, data["scene"]]))[
            draw(st.sampled_from(["alhpa", "x" * 5000, "", "é", 5]))
        ] = 1.0
        return data, ""
    name = draw(st.sampled_from([*FIELDS] if part == "table" else FIELDS[part]))
    if part == "table":
        table = data if name in ("scene", "gears") else data["scene"]
    elif part == "scene":
        table = data["scene"]
    else:
        table = (data if part == "gears" else data["scene"]).setdefault(part, {})
    table[name] = draw(BAD)
    return data, name


@tried(spoilt=spoilt_scenes(), inputs=200)
def test_bad_scenes_are_refused_by_name(spoilt):
    data, name = spoilt
    try:
        scene = Scene.from_dict(data)
    except InputError as error:
        refused(error, name if error.field not in ("scene", "gears") else "")
        return
    assert Scene.from_toml(scene.to_toml()) == scene
    assert finite(scene)


CALLS = {
    ("impacts", "closure", "order"): lambda **k: mean_map(DAT, **({"impacts": 1} | k)),
    (
        "paths",
        "impacts",
        "dt",
        "scheme",
        "rng",
        "workers",
        "times",
        "itineraries",
        "increments",
        "horizon",
    ): (lambda **k: simulate(DAT, **recorded({"paths": 32, "impacts": 1, "horizon": 5.0} | k))),
    ("accuracy", "impacts", "scheme", "rng", "workers", "budget"): (
        lambda **k: simulate_to(DAT, **({"accuracy": 0.5, "impacts": 1, "budget": 2.0} | k))
    ),
    ("impacts", "closures", "paths", "dt", "scheme", "rng", "workers", "order"): (
        lambda **k: validate(DAT, **({"impacts": 1, "paths": 64, "closures": ["corrected"]} | k))
    ),
    ("sigma",): DAT.with_sigma,
    ("times",): lambda **k: mean_map(DAT, impacts=2).at_times(**k),
    ("impact", "quantity"): (
        lambda **k: mean_map(DAT, impacts=2).density(
            **{"impact": 1, "quantity": "y1", "values": np.zeros(1)} | k
        )
    ),
    ("impact", "stage"): lambda **k: mean_map(DAT, impacts=2).edgeworth(
        **{"impact": 1, "stage": 1} | k
    ),
    ("text",): Scene.from_toml,
    ("path",): Scene.load,
    ("data",): Scene.from_dict,
}
"""Public calls by the settings that they take."""
STUDIES = {"path": (Study.load, load_study), "text": (Study.from_toml,)}


@pytest.mark.filterwarnings("ignore::rattle.AccuracyWarning")
@tried(
    place=st.sampled_from([(names, name) for names in CALLS for name in names]),
    value=BAD,
    inputs=150,
)
def test_bad_settings_are_refused_by_name(place, value):
    names, name = place
    of_studies = [partial(call, value) for call in STUDIES.get(name, ())]
    for call in (partial(CALLS[names], **{name: value}), *of_studies):
        try:
            call()
        except RattleError as error:
            refused(error, "" if name in ("text", "path", "data") else name.rstrip("s"))


SETTINGS = "seed = 3\nwithin = { mean = 0.05, sd = 0.1 }"
STUDY = study(
    "bad", closures=("saltation", "corrected"), sigma="{ log = [0.01, 0.1, 2] }", more=SETTINGS
)
STUDY += '\n[[axes]]\ngap1 = [0.4, 0.5]\n"tolerance.c1_max" = [0.0, 0.01]\n'


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with scene and study files, a finished study, and a report."""
    place = tmp_path_factory.mktemp("fuzz")
    (place / "scene.toml").write_text(DAT.to_toml(), encoding="utf-8")
    (place / "bad.toml").write_text("[scene]\nalpha = 'x'\n", encoding="utf-8")
    (place / "study.toml").write_text(STUDY, encoding="utf-8")
    (place / "baseline.toml").write_text(
        "[values.y1]\n1 = 0.5\n\n" + DAT.to_toml(), encoding="utf-8"
    )
    small = "--paths 64 --impacts 1 --sigma 0.1 --no-validity --workers 1 --out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("matplotlib.figure.Figure.savefig", lambda figure, file, **settings: None)
        rattle("study", place / "study.toml", "--workers", 1)
        rattle("validate", *small.split(), place / "report")
    return place


def read_study_text(path):
    study = Study.from_toml(path.read_text(encoding="utf-8"))
    return study.cells if len(study.points) < 50 else ()


READERS = {
    "scene.toml": lambda path: Scene.from_toml(path.read_text(encoding="utf-8")).to_toml(),
    "study.toml": read_study_text,
    "report/manifest.json": manifest.read_settings,
    "report/report.md": read_page,
    "baseline.toml": read_baseline,
}
TOKENS = (
    "",
    "nan",
    "inf",
    "-inf",
    "1e400",
    "-1",
    "0",
    "9" * 5000,
    "'x'",
    '"',
    "[",
    "]",
    "[[",
    "{",
    "}",
    "=",
    "\n",
    "true",
    "[scene]\n",
    "1979-05-27",
    "é",
    "\x00",
    "\ufeff",
    "[[axes]]\n",
    "[" * 3000,
    "a.b.c = 1\n",
    "1_0",
    "0x1F",
    "sigma = 1\n",
    "#",
    "paths = 1e9\n",
    "seed = [1]\n",
    "[1, 10, 1000000000]",
)
CUTS = st.lists(
    st.tuples(st.floats(0.0, 1.0), st.integers(0, 12), st.sampled_from(TOKENS)),
    min_size=1,
    max_size=3,
)


def read_or_refused(name, place, text):
    path = place / "spoilt"
    path.write_text(text, encoding="utf-8")
    try:
        READERS[name](path)
    except RattleError as error:
        refused(error, "")


@tried(name=st.sampled_from(sorted(READERS)), cuts=CUTS, inputs=80)
def test_spoilt_texts_are_refused_or_read(name, cuts, place):
    text = (place / name).read_text(encoding="utf-8")
    for share, length, token in cuts:
        at = int(share * len(text))
        text = text[:at] + token + text[at + length :]
    read_or_refused(name, place, text)


def damaged_cell(place, share, bit=0):
    """How a cell with a flipped bit ends: refused, or read as it was written."""
    study = Study.load(place / "study.toml")
    good = store.Store(place / "study" / "cells")
    cell = study.cells[int(share * 1e6) % len(study.cells)]
    truth = good.read(cell)
    content = bytearray(good.path(cell).read_bytes())
    content[int(share * len(content))] ^= 1 << bit
    with tempfile.TemporaryDirectory(dir=place) as scratch:
        damaged = store.Store(type(place)(scratch))
        damaged.path(cell).write_bytes(content)
        found = damaged.read(cell)
    if found is None:
        return "refused"
    pd.testing.assert_frame_equal(found.section, truth.section, check_exact=True)
    assert found.facts == truth.facts
    return "read"


@tried(share=st.floats(0.0, 1.0, exclude_max=True), bit=st.integers(0, 7), inputs=60)
def test_damaged_cells_are_refused_or_read_as_written(share, bit, place):
    damaged_cell(place, share, bit)


def test_an_error_without_the_name_of_its_field_is_seen():
    with pytest.raises(AssertionError, match="does not name"):
        refused(InputError("x", 1, "is bad"), "alpha")
