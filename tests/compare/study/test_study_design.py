"""The study file: axes, products and zips, keys, and every refusal."""

import re
from dataclasses import asdict

import numpy as np
import pytest
from study_files import study_text

from rattle import InputError, Study
from rattle.compare.study.cells import Prediction, Sample
from rattle.compare.study.design import AXIS_EXAMPLE
from rattle.scene import DAT21, Order


def read(**settings):
    return Study.from_toml(study_text(**settings))


def geared(**changes):
    """A study of DAT21, with some of its values changed."""
    gears = "".join(f"{name} = {value!r}\n" for name, value in {**asdict(DAT21), **changes}.items())
    return re.sub(r"\[scene\].*?\n\n", f"[gears]\n{gears}\n", study_text(), flags=re.DOTALL)


def test_a_study_file_is_asked_whether_its_gears_can_be(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(geared())
    assert Study.load(file).gears == DAT21
    file.write_text(geared(inertia1=0.004, damping1=0.0))
    assert (
        Study.from_toml(file.read_text()).gears.inertia1 == 0.004
    )  # only what was written in a file is questioned
    line = file.read_text().splitlines().index("inertia1 = 0.004") + 1
    said = rf"mine\.toml, line {line}: gears\.inertia1 = 0\.004: is too little"
    with pytest.raises(InputError, match=said) as caught:
        Study.load(file)
    assert "if 0.004 is in kg m^2, write 4000" in str(caught.value)


def test_axes_multiply_and_fields_of_one_table_go_together():
    study = read(
        more=(
            '[[axes]]\ngap1 = [0.4, 0.5]\ngap2 = [0.5, 0.6]\n[[axes]]\n"tolerance.c1_max" = [0.0,'
            " 0.01]\n"
        )
    )
    assert len(study.points) == 3 * 2 * 2
    assert [(p.sample.scene.gap1, p.sample.scene.gap2) for p in study.points[:4:2]] == [
        (0.4, 0.5),
        (0.5, 0.6),
    ]
    assert study.points[1].sample.scene.tolerance.c1_max == 0.01
    assert study.points[0].sample.scene.start.x1 == 0.4  # the paper's start follows the gap


def test_log_and_linear_axes_keep_their_ends():
    text = study_text().replace("[0.01, 0.02, 0.05]", "{ log = [1e-3, 2.0, 24] }")
    sigmas = [p.coordinates["sigma"] for p in Study.from_toml(text).points]
    assert (sigmas[0], sigmas[-1], len(sigmas)) == (0.001, 2.0, 24)
    np.testing.assert_allclose(np.diff(np.log(sigmas)), np.log(2000) / 23, rtol=1e-4)
    text = study_text().replace("[0.01, 0.02, 0.05]", "{ linear = [0.1, 0.5, 5] }")
    assert [p.coordinates["sigma"] for p in Study.from_toml(text).points] == [
        0.1,
        0.2,
        0.3,
        0.4,
        0.5,
    ]


def test_a_key_is_the_content():
    """Two files that say the same share their cells; a change of anything that matters makes new
    ones."""
    cells = {c.key for c in read().cells}
    assert cells == {
        c.key for c in Study.from_toml(study_text().replace('"small"', '"other"')).cells
    }
    assert (
        len({c.key for c in read(sigmas=(0.01, 0.02, 0.05, 0.1)).cells} - cells) == 3
    )  # a value more: its cells only
    for changed in (read(paths=8192), read(impacts=3)):
        assert not {c.key for c in changed.cells if isinstance(c, Sample)} & cells
    assert {
        c.key for c in read(paths=8192).cells if isinstance(c, Prediction)
    } < cells  # closures do not care


def test_common_noise_is_one_seed_and_own_noise_is_many():
    assert {p.sample.seed for p in read().points} == {3}
    own = [p.sample.seed for p in read(common="false").points]
    assert len(set(own)) == 3
    assert own == [p.sample.seed for p in read(common="false").points]


def test_an_invalid_point_says_why_and_the_others_stand():
    study = read(more="[[axes]]\nepsilon = [0.9, 1.2]\n")
    lost = [p for p in study.points if p.sample is None]
    assert len(lost) == 3
    assert "epsilon = 1.2" in lost[0].reasons["scene"]
    assert len(study.cells) == 9


@pytest.mark.parametrize(
    ("change", "field", "remedy"),
    [
        (("sigma = [", "sigme = ["), "sigme", "did you mean 'sigma'"),
        (("[0.01, 0.02, 0.05]", "[]"), "axes.sigma", "has no values"),
        (("[0.01, 0.02, 0.05]", "0.1"), "axes.sigma", "write {"),
        (("[0.01, 0.02, 0.05]", "[0.1, 0.1]"), "axes.sigma", "twice"),
        (("[0.01, 0.02, 0.05]", "{ log = [0.0, 1.0, 3] }"), "axes.sigma LOW", "greater than 0"),
        (
            ("[0.01, 0.02, 0.05]", "{ linear = [2.0, 1.0, 3] }"),
            "axes.sigma HIGH",
            "greater than LOW",
        ),
        (("[0.01, 0.02, 0.05]", "{ cubic = [0.0, 1.0, 3] }"), "axes.sigma", "unknown key"),
        (("impacts = 2", "impact = 2"), "impact", "did you mean 'impacts'"),
        (("paths = 4096", ""), "study.paths", "either paths or accuracy"),
        (
            ("paths = 4096", "paths = 4096\naccuracy = 0.1"),
            "study.paths",
            "either paths or accuracy",
        ),
        (("paths = 4096", "accuracy = 0.1\ndt = 0.01"), "study.dt", "leave it out"),
        (
            ('["saltation", "corrected"]', '["saltations"]'),
            "study.closures",
            "did you mean 'saltation'",
        ),
        (
            ('["saltation", "corrected"]', '["nowhere:mine"]'),
            "study.closures = 'nowhere:mine'",
            "cannot be imported",
        ),
        (("seed = 3", "seed = 3\nwithin = { means = 0.1 }"), "study.within", "did you mean 'mean'"),
        (("common_noise = true", "common_noise = 1"), "study.common_noise", "true or false"),
        (("epsilon = 0.9", "epsilon = 1.9"), "epsilon", "between 0 and 1"),
        (("[scene]", "[scene"), "TOML", "correct the file"),
        (("[0.01, 0.02, 0.05]", "[-1.0, -2.0]"), "study", "not one point"),
        (("[[axes]]", "[[axes]]\nsigma = [0.3]\n[[axes]]"), "axes", "two axes"),
        (
            ("sigma = [0.01, 0.02, 0.05]", "gap1 = [0.4, 0.5]\ngap2 = [0.5]"),
            "axes",
            "as many values",
        ),
        (("sigma = [0.01, 0.02, 0.05]", "paths = [1024]"), "study.paths", "along an axis too"),
    ],
)
def test_a_bad_file_is_refused_with_field_and_remedy(change, field, remedy):
    text = study_text()
    assert change[0] in text
    with pytest.raises(InputError) as refused:
        _ = Study.from_toml(text.replace(*change)).points
    assert field in str(refused.value)
    assert remedy in str(refused.value)


@pytest.mark.parametrize("example", [*re.findall(r"\{.*?\}", AXIS_EXAMPLE), "[0.1, 0.2]"])
def test_the_values_that_messages_propose_are_taken(example):
    assert len(Study.from_toml(study_text().replace("[0.01, 0.02, 0.05]", example)).points) > 1


def test_the_tolerances_that_a_message_proposes_are_taken():
    with pytest.raises(InputError) as refused:
        Study.from_toml(study_text().replace("seed = 3", "seed = 3\nwithin = 0.1"))
    proposed = str(refused.value).split("table: ")[1]
    assert (
        Study.from_toml(study_text().replace("seed = 3", f"seed = 3\n{proposed}")).within.mean
        == 0.05
    )


def test_the_numerical_version_is_in_the_key(monkeypatch):
    before = {c.key for c in read().cells}
    monkeypatch.setattr(
        "rattle.compare.engine.store.numerical_version", lambda *packages: "another"
    )
    assert not before & {c.key for c in read().cells}


ORDERS = (
    "[[drive]]\norder = 1\namplitude = 1.0\n[[drive]]\norder = 4\namplitude = 0.1\nphase = 1.0\n"
)


def test_an_axis_varies_one_order_and_keeps_the_others():
    study = Study.from_toml(
        study_text(
            more=ORDERS
            + '[[axes]]\n"drive.2.amplitude" = [0.0, 0.2]\ncorrelation_time = [0.0, 0.5]\n'
        )
    )
    last = study.points[-1].sample.scene
    assert last.drive == (Order(1), Order(2, 0.2), Order(4, 0.1, 1.0))
    assert last.correlation_time == 0.5
    assert study.points[0].sample.scene.drive[1] == Order(2, 0.0)


def test_a_scene_without_orders_has_the_key_that_it_had():
    plain = Study.from_toml(study_text())
    sine = Study.from_toml(study_text(more="[[drive]]\norder = 1\namplitude = 1.0\n"))
    assert [cell.key for cell in plain.cells] == [cell.key for cell in sine.cells]
    assert [cell.key for cell in plain.cells] != [
        cell.key for cell in Study.from_toml(study_text(more=ORDERS)).cells
    ]


@pytest.mark.parametrize("name", ["drive.0.amplitude", "drive.2", "drive.2.order", "drive.x.phase"])
def test_no_field_of_an_order_is_refused(name):
    with pytest.raises(InputError, match="no field of a scene"):
        Study.from_toml(study_text(more=f'[[axes]]\n"{name}" = [0.1, 0.2]\n'))
