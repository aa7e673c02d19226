"""Results come back from another process, as pools and clusters send them."""

import re
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import pytest

from rattle import Study, stationary, validate
from rattle.closure import CLOSURES, follow, mean_map
from rattle.montecarlo import simulate
from rattle.scene import DAT21, Scene

SCENE = Scene.from_gears(DAT21, sigma=0.1)
STUDIES = Path(__file__).resolve().parent.parent / "reports" / "studies"
RESULTS = {
    **{closure: (mean_map, SCENE, {"impacts": 2, "closure": closure}) for closure in CLOSURES},
    "orbit": (follow, SCENE, {"impacts": 2}),
    "ensemble": (simulate, SCENE, {"impacts": 2, "paths": 64}),
    "validation": (validate, SCENE, {"impacts": 2, "paths": 64, "scheme": "exact-flight"}),
    "long run": (stationary, SCENE, {"periods": 64}),
    "study": (Study.load, STUDIES / "noise.toml", {}),
}


@pytest.fixture(scope="module")
def pool():
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor:
        yield executor


def shown(result):
    """The repr of a result without the time that it took."""
    return re.sub(r", [0-9.]+ s$", "", repr(result), flags=re.MULTILINE)


@pytest.mark.parametrize("name", RESULTS)
def test_a_result_comes_back_from_a_process(pool, name):
    call, given, options = RESULTS[name]
    there = pool.submit(call, given, **options).result()
    here = call(given, **options)
    assert type(there) is type(here)
    assert shown(there) == shown(here)
    if hasattr(here, "section"):
        assert there.section.equals(here.section)
    if name in CLOSURES:
        assert there.at_times([0.3, 0.9]).equals(here.at_times([0.3, 0.9]))
