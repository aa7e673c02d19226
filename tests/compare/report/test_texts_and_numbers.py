"""What pages and messages make of numbers, and small formulas behind them."""

import numpy as np
import pandas as pd
import pytest

from rattle.compare.animation.page import Wheel
from rattle.compare.animation.record import check_recording
from rattle.compare.checks.stability.chart import FIRST_PATHS, PATHS_GROWTH, sizes
from rattle.compare.report.provenance import command_line
from rattle.compare.report.render import as_block, as_markdown
from rattle.compare.report.style import caption_of, legend_above, new_figure, whole_impacts
from rattle.compare.report.table import Table
from rattle.compare.thresholds.claim import Settings
from rattle.compare.thresholds.messages import row_table
from rattle.compare.tradeoff.multilevel import fit
from rattle.compare.validation.comparison import paths_for
from rattle.compare.validation.realizability import (
    covariance_eigenvalue,
    kurtosis_margin,
    moment_matrix_eigenvalue,
)
from rattle.montecarlo.diagnostics.reference import at_wall
from rattle.scene import DAT21, InputError, Scene
from rattle.scene.moments import gaussian_raw_moments


def test_texts():
    assert as_markdown("# <b> *x* `a_b` a_b") == r"\# \<b> \*x\* `a_b` a_b"
    assert as_block("a ```` b\n", "sh") == "`````sh\na ```` b\n`````"
    assert command_line(["show", "my report"]) == "rattle show 'my report'"
    frame = pd.DataFrame({"scheme": ["exact-flight"], "paths": [4000]})
    (cells,) = Table.whole(frame, ["scheme"]).rows
    assert [cell.text for cell in cells] == ["exact-flight", "4,000"]
    row = {
        "moment": "mean",
        "quantity": "y1",
        "impact": 2,
        "predicted": 1.13,
        "simulated": 1.03,
        "error": 0.1,
    }
    row |= {
        "low": 0.08,
        "high": 0.12,
        "tolerance": 0.005,
        "unit": 0.1,
        "agreement": 1.0,
        "verdict": "inaccurate",
    }
    assert row_table(pd.DataFrame([row])).split("\n")[1].split() == [
        "E",
        "y1",
        "at",
        "2",
        "1.13",
        "1.03",
        "+1.0000",
        "+0.8000",
        "+1.2000",
        "0.0500",
        "1.0000",
    ]
    with pytest.raises(
        InputError, match=r"^sigma = 0.0: nothing is random, so both paths are the same; give noise"
    ):
        check_recording(Scene.from_gears(DAT21), 12, 0)


def test_axes_and_captions_say_what_is_drawn():
    figure, (ax,) = new_figure(2.0, 2.0, 1, 1)
    ax.plot([0.5, 3.5], [0.0, 1.0], label="closure")
    whole_impacts(ax)
    assert all(tick.is_integer() for tick in ax.get_xticks())
    legend_above(figure, [ax], 1)
    words = (
        ("Means", ""),
        (" of the closure", "closure"),
        (" and of the paths", "Monte"),
        (".", ""),
    )
    assert caption_of(figure, words) == "Means of the closure."


def test_margins_of_gaussian_moments():
    raw = gaussian_raw_moments(4.0, 1.0, 1.0, 4)
    assert kurtosis_margin(raw).value == pytest.approx(2.0)  # kurtosis 3, at least 1
    assert moment_matrix_eigenvalue(raw).value == pytest.approx(0.2682, abs=1e-4)
    raw[2, 2] = 0.5  # E[u^2 v^2] = 0.125, below rho^2 = 0.25
    assert moment_matrix_eigenvalue(raw).value < 0.0
    assert covariance_eigenvalue(np.array([[2.0, 3.0], [3.0, 2.0]])) == pytest.approx(
        -0.5
    )  # 1 - |rho|


def test_numbers_of_paths_and_steps():
    assert (
        paths_for(pd.DataFrame({"unit": [1.0], "se": [1.0]}), 0.0196) == 10_000
    )  # 1.96 standard errors
    assert Settings().sizes(10_000, None) == (10_000, 20_000, 40_000, 80_000)
    assert Settings(budget=30_000).sizes(10_000, None) == (10_000, 20_000, 30_000)
    assert Settings().sizes(10_000, 1) == (10_000,)
    most = (FIRST_PATHS, FIRST_PATHS + 1, FIRST_PATHS * PATHS_GROWTH**2)
    assert [len(sizes(paths)) for paths in most] == [1, 2, 3]
    rate = fit(np.array([1.0, 2.0, 3.0]), np.array([0.5, 0.25, 0.125]))
    assert rate == pytest.approx((-1.0, 0.0, 0.0), abs=1e-12)
    assert at_wall(np.array(["x1", "x2", "y1"]), np.array([1, 1, 1])).tolist() == [
        True,
        False,
        False,
    ]
    wheel = Wheel(6.0, 0.35)
    assert 2.0 * wheel.half_angle(6.0) * 6.0 / wheel.pitch == pytest.approx(
        0.35
    )  # teeth fill their share of a pitch
