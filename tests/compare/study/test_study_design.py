"""The study file: axes, products and zips, keys, and every refusal."""

import re

import numpy as np
import pytest
from refusals import refusal
from studies import Prediction, Sample, study_text

from rattle import DAT21, Order, Study

ORDERS_TEXT = (
    "[[drive]]\norder = 1\namplitude = 1.0\n[[drive]]\norder = 4\namplitude = 0.1\nphase = 1.0\n"
)


def read(**settings):
    return Study.from_toml(study_text(**settings))


def geared(**changes):
    """A study of DAT21, with some of its values changed."""
    gears = "".join(f"{name} = {value!r}\n" for name, value in {**DAT21.values, **changes}.items())
    return re.sub(r"\[scene\].*?\n\n", f"[gears]\n{gears}\n", study_text(), flags=re.DOTALL)


def test_a_study_file_is_asked_whether_its_gears_can_be(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(geared())
    assert Study.load(file).scene.gears == DAT21
    file.write_text(geared(inertia1=0.004, damping1=0.0))
    line = file.read_text().splitlines().index("inertia1 = 0.004") + 1
    with refusal(rf"mine\.toml, line {line}: gears\.inertia1 = 0\.004: is too little"):
        Study.load(file)


def test_axes_multiply_and_fields_of_one_table_go_together():
    gaps = "[[axes]]\ngap1 = [0.4, 0.5]\ngap2 = [0.5, 0.6]\n"
    points = read(more=f'{gaps}[[axes]]\n"tolerance.c1_max" = [0.0, 0.01]\n').points
    assert len(points) == 3 * 2 * 2
    first, second, third, *_ = (point.sample.scene for point in points)
    assert (first.gap1, first.gap2, third.gap1, third.gap2) == (0.4, 0.5, 0.5, 0.6)
    assert second.tolerance.c1_max == 0.01
    assert first.start.x1 == 0.4  # the paper's start follows the gap


def keys(cells, kind=object):
    return {cell.key for cell in cells if isinstance(cell, kind)}


def with_sigma(values):
    """A study over other values of sigma."""
    return Study.from_toml(study_text().replace("[0.01, 0.02, 0.05]", values))


def test_log_and_linear_axes_keep_their_ends():
    log, linear = (
        [p.coordinates["sigma"] for p in with_sigma(values).points]
        for values in ("{ log = [1e-3, 2.0, 24] }", "{ linear = [0.1, 0.5, 5] }")
    )
    assert (log[0], log[-1], len(log)) == (0.001, 2.0, 24)
    np.testing.assert_allclose(np.diff(np.log(log)), np.log(2000) / 23, rtol=1e-4)
    assert linear == [0.1, 0.2, 0.3, 0.4, 0.5]


def test_a_key_is_the_content(monkeypatch):
    """Two files that say the same share their cells; a change of anything that matters makes new
    ones."""
    before = keys(read().cells)
    assert keys(Study.from_toml(study_text().replace('"small"', '"other"')).cells) == before
    # a value more: its cells only
    assert len(keys(read(sigmas=(0.01, 0.02, 0.05, 0.1)).cells) - before) == 3
    more_paths = read(paths=8192).cells
    assert not keys(more_paths, Sample) & before
    assert keys(more_paths, Prediction) < before  # closures do not care
    assert keys(read(more="[[drive]]\norder = 1\namplitude = 1.0\n").cells) == before
    assert not keys(read(more=ORDERS_TEXT).cells) & before
    monkeypatch.setattr("rattle.compare.engine.store.numerical_version", lambda *_: "another")
    assert not before & keys(read().cells)


def test_common_noise_is_one_seed_and_own_noise_is_many():
    assert {p.sample.seed for p in read().points} == {3}
    assert len({p.sample.seed for p in read(common="false").points}) == 3


def test_an_invalid_point_says_why_and_the_others_stand():
    study = read(more="[[axes]]\nepsilon = [0.9, 1.2]\n")
    lost = [p.reasons["scene"] for p in study.points if p.sample is None]
    assert ["epsilon = 1.2" in reason for reason in lost] == [True] * 3
    assert len(study.cells) == 9


SIGMAS_LINE = "[0.01, 0.02, 0.05]"
CLOSURES_LINE = '["saltation", "corrected"]'
AXIS = f"sigma = {SIGMAS_LINE}"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("sigma = [", "sigme = [", "sigme.*did you mean 'sigma'"),
        (SIGMAS_LINE, "[]", r"axes\.sigma.*has no values"),
        (SIGMAS_LINE, "0.1", r"axes\.sigma.*write \{"),
        (SIGMAS_LINE, "[0.1, 0.1]", r"axes\.sigma.*twice"),
        (SIGMAS_LINE, "{ log = [0.0, 1.0, 3] }", r"axes\.sigma LOW.*greater than 0"),
        (SIGMAS_LINE, "{ linear = [2.0, 1.0, 3] }", r"axes\.sigma HIGH.*greater than LOW"),
        (SIGMAS_LINE, "{ cubic = [0.0, 1.0, 3] }", r"axes\.sigma.*unknown key"),
        (SIGMAS_LINE, "[-1.0, -2.0]", "study.*not one point"),
        ("impacts = 2", "impact = 2", "impact.*did you mean 'impacts'"),
        ("paths = 4096", "paths = 4096\naccuracy = 0.1", r"study\.paths.*either paths or accuracy"),
        ("paths = 4096", "accuracy = 0.1\ndt = 0.01", r"study\.dt.*leave it out"),
        (CLOSURES_LINE, '["saltations"]', r"study\.closures.*did you mean 'saltation'"),
        (
            CLOSURES_LINE,
            '["nowhere:mine"]',
            r"study\.closures = 'nowhere:mine'.*cannot be imported",
        ),
        ("seed = 3", "within = { means = 0.1 }", r"study\.within.*did you mean 'mean'"),
        ("common_noise = true", "common_noise = 1", r"study\.common_noise.*true or false"),
        ("[scene]", "[scene", "TOML.*correct the file"),
        ("[[axes]]", "[[axes]]\nsigma = [0.3]\n[[axes]]", "axes.*two axes"),
        (AXIS, "gap1 = [0.4, 0.5]\ngap2 = [0.5]", "axes.*as many values"),
        (AXIS, "paths = [1024]", r"study\.paths.*along an axis too"),
        ("paths = 4096", "near_branches = true\naccuracy = 0.1", "near_branches.*accuracy = 0.1"),
        (
            "paths = 4096",
            'near_branches = true\npaths = 64\nscheme = "euler-maruyama"',
            "near_branches.*scheme = euler-maruyama",
        ),
        (AXIS, '"drive.2.order" = [0.1, 0.2]', "no field of a scene"),
    ],
)
def test_a_bad_file_is_refused_with_field_and_remedy(old, new, message):
    text = study_text()
    assert old in text
    with refusal(f"(?s){message}"):
        _ = Study.from_toml(text.replace(old, new)).points


def test_rare_branches_need_white_noise():
    text = study_text(more="[[axes]]\ncorrelation_time = [0.1, 0.2]\n")
    with refusal(r"near_branches.*correlation_time = 0\.1"):
        _ = Study.from_toml(text.replace("seed = 3", "near_branches = true")).points


def test_an_axis_varies_one_order_and_keeps_the_others():
    axes = '[[axes]]\n"drive.2.amplitude" = [0.0, 0.2]\ncorrelation_time = [0.0, 0.5]\n'
    first, *_, last = (p.sample.scene for p in read(more=ORDERS_TEXT + axes).points)
    assert last.drive == (Order(1), Order(2, 0.2), Order(4, 0.1, 1.0))
    assert last.correlation_time == 0.5
    assert first.drive[1] == Order(2, 0.0)
