"""What a report says of gears in ms, mm, mm/s and mJ; and that a scene without gears says none of
it."""

import numpy as np
import pytest
from scenes import UNGEARED, dat21

from rattle import validate
from rattle.compare.validation.answer import answer
from rattle.compare.validation.tables import duration_words, motion_table, time_table

EXACT_FLIGHTS = {
    "impacts": 3,
    "closures": ["saltation"],
    "paths": 2000,
}


@pytest.fixture(scope="module")
def v():
    return validate(dat21(0.02), **EXACT_FLIGHTS)


def values(table, head):
    """Means in a column whose cells are "mean ± sd"."""
    column = [c.head for c in table.columns].index(head)
    return np.array([float(row[column].text.split(" ±")[0]) for row in table.rows])


def test_the_motion_stands_in_both_systems_of_units(v):
    table = motion_table(v)
    section = v.run.section
    assert values(table, "τ") == pytest.approx(section["tau"], rel=1e-3)
    assert values(table, "y2 [mm/s]") == pytest.approx(60.0 * section["y2"], rel=1e-3)
    assert values(time_table(v), "x1 [mm]") == pytest.approx(
        0.2 * v.run.at_times()["x1"], rel=1e-3, abs=1e-6
    )
    # kg mm^2/s^2 of the rim's mass at the unit of speed
    assert values(table, "energy [mJ]") == pytest.approx(
        (1e-3 * 4000.0 / 41.0**2 * 60.0**2) * section["energy"], rel=1e-2
    )


def test_the_answer_speaks_of_milliseconds(v):
    time = v.run.section["tau"].iloc[-1] / 0.3
    said = f"these gears: at σ = 0.02, 3 impacts take {time:.3g} ms on average, "
    assert said in " ".join(answer([v]))
    assert duration_words(v) == f"the first {time:.3g} ms"


@pytest.mark.usefixtures("undrawn")
def test_pages_of_gears_have_physical_units_and_others_have_not(v, tmp_path):
    plain = validate(UNGEARED.with_sigma(0.02), **EXACT_FLIGHTS)
    for one, has in ((v, True), (plain, False)):
        one.report(tmp_path / str(has))
        text = (tmp_path / str(has) / "report.md").read_text()
        for words in ("mm/s", " ms on average", "mJ", "1 is 3.333 ms for these gears"):
            assert (words in text) == has, words
        assert "per second" not in text  # which is said of the long run alone
