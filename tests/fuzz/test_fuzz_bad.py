"""Bad input leads to one of our errors that names it, or to an answer.

Settings and texts with something wrong in them, always the same.
"""

import math
from decimal import Decimal
from fractions import Fraction
from functools import partial

import numpy as np
import pytest
from commands import study
from fuzz_must import refused
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from scenes import dat21

from rattle import (
    Record,
    Sampling,
    Scene,
    Study,
    load_study,
    mean_map,
    simulate,
    simulate_to,
    validate,
)
from rattle.scene import RattleError

DAT = dat21(0.1)


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


ANYTHING = st.sampled_from(
    [
        math.nan,
        math.inf,
        "",
        "0.5",
        "é\x00",
        1j,
        [],
        [[0.5]],
        {},
        {"a": 0.5},
        True,
        Decimal("0.5"),
        np.array([0.5, 0.6]),
        "x" * 10_000,
        None,
        0,
        -1,
        1.5,
        -1e-300,
        5e-324,
        1e-31,
        10**30,
        2**63,
        Fraction(1, 3),
        -0.0,
    ]
)
"""What nothing here takes, and numbers that one field takes and another does not."""


SAMPLE = partial(simulate, DAT, paths=32, impacts=1, sampling=Sampling(horizon=5.0))


def record(**settings):
    return SAMPLE(record=Record(**settings))


def of_two_impacts(method, **settings):
    return getattr(mean_map(DAT, impacts=2), method)(**settings)


def sample(**settings):
    return SAMPLE(sampling=Sampling(**settings))


CALLS = {
    "impacts closure order": partial(mean_map, DAT, impacts=1),
    "paths impacts dt scheme rng workers": SAMPLE,
    "times itineraries": record,
    "increments horizon": sample,
    "accuracy impacts scheme rng workers budget": partial(
        simulate_to, DAT, accuracy=0.5, impacts=1, budget=2.0
    ),
    "impacts closures paths dt scheme rng workers order": partial(
        validate, DAT, impacts=1, paths=64, closures=["corrected"]
    ),
    "sigma": DAT.with_sigma,
    "times": partial(of_two_impacts, "at_times"),
    "impact quantity": partial(
        of_two_impacts, "density", impact=1, quantity="y1", values=np.zeros(1)
    ),
    "impact stage": partial(of_two_impacts, "edgeworth", impact=1, stage=1),
    "text": Scene.from_toml,
    "path": Scene.load,
    "data": Scene.from_dict,
}
"""Public calls by the settings that they take."""
STUDY_CALLS = {"path": (Study.load, load_study), "text": (Study.from_toml,)}


@pytest.mark.filterwarnings("ignore::rattle.montecarlo.AccuracyWarning")
@tried(
    place=st.sampled_from([(names, name) for names in CALLS for name in names.split()]),
    value=ANYTHING,
    inputs=150,
)
def test_bad_settings_are_refused_by_name(place, value):
    names, name = place
    of_studies = [partial(call, value) for call in STUDY_CALLS.get(name, ())]
    for call in (partial(CALLS[names], **{name: value}), *of_studies):
        try:
            call()
        except RattleError as error:
            refused(error, "" if name in ("text", "path", "data") else name.rstrip("s"))


WHOLE_STUDY = study(
    "bad",
    closures=("saltation", "corrected"),
    sigma="{ log = [0.01, 0.1, 2] }",
    more="seed = 3\nwithin = { mean = 0.05, sd = 0.1 }",
)
WHOLE_STUDY += '\n[[axes]]\ngap1 = [0.4, 0.5]\n"tolerance.c1_max" = [0.0, 0.01]\n'


def read_study(text):
    study = Study.from_toml(text)
    return study.cells if len(study.points) < 50 else ()


TEXT_READERS = [(Scene.from_toml, DAT.to_toml()), (read_study, WHOLE_STUDY)]
TOKENS = (
    "",
    "nan",
    "1e400",
    "9" * 5000,
    "'x'",
    "[",
    "\n",
    "true",
    "[scene]\n",
    "1979-05-27",
    "é",
    "\x00",
    "[" * 3000,
    "sigma = 1\n",
    "[1, 10, 1000000000]",
)
CUTS = st.lists(
    st.tuples(st.floats(0.0, 1.0), st.integers(0, 12), st.sampled_from(TOKENS)),
    min_size=1,
    max_size=3,
)


@tried(reader=st.sampled_from(TEXT_READERS), cuts=CUTS, inputs=80)
def test_spoilt_texts_are_refused_or_read(reader, cuts):
    read, text = reader
    for share, length, token in cuts:
        at = int(share * len(text))
        text = text[:at] + token + text[at + length :]
    try:
        read(text)
    except RattleError as error:
        refused(error, "")
