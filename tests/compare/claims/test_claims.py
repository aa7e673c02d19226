"""The paper's claims: every verdict can come out either way, and the page says what was found."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from rattle.compare.chaos.exponents import Mean
from rattle.compare.claims import judged, of_moments, of_motion
from rattle.compare.claims.claim import NOT_REPRODUCED, REPRODUCED, UNDECIDED, table
from rattle.compare.claims.evidence import gather
from rattle.compare.claims.figure import verdict_figure
from rattle.compare.claims.page import answer, write_claims
from rattle.compare.cli.main import main
from rattle.compare.report import read_page
from rattle.scene import DAT21, Scene

pytestmark = pytest.mark.filterwarnings("ignore:.*too short.*")


@pytest.fixture(scope="module")
def evidence():
    return gather(
        Scene.from_gears(DAT21), sigmas=(0.02,), at=(0.3, 1.0, 2.0), paths=4000, points=20_000,
        spectrum_impacts=20_000, events=128, impacts=6,
    )  # fmt: skip


@pytest.fixture(scope="module")
def claims(evidence):
    return {function.__name__: claim for function, claim in zip(judged.CLAIMS, judged.judge(evidence), strict=True)}


def test_every_claim_has_a_test_evidence_and_one_of_the_verdicts(claims):
    for claim in claims.values():
        assert all(claim)
        assert claim.verdict in (REPRODUCED, NOT_REPRODUCED, UNDECIDED) or claim.verdict.startswith("holds only for ")
        assert any(c.isdigit() for c in claim.evidence)
    assert len(table(list(claims.values()))) == 12


@pytest.mark.parametrize(
    ("name", "verdict"),
    [
        ("solvable", NOT_REPRODUCED),
        ("beyond_one", "holds only for the published rule"),
        ("stages_apart", NOT_REPRODUCED),
        ("counter_meshes", NOT_REPRODUCED),
        ("chaotic_range", "holds only for"),
        ("describes", "holds only for closures right to first order"),
    ],
)
def test_verdicts_on_dat21(claims, name, verdict):
    assert claims[name].verdict.startswith(verdict)


def test_another_covariance_would_not_pass_for_the_solution(evidence):
    control = replace(evidence, open_space=replace(evidence.open_space, beta1=0.3))
    assert of_moments.solvable(control).verdict == UNDECIDED


def test_a_corrected_correlation_beyond_one_would_reproduce_the_claim(evidence):
    v = evidence.validations[0]
    rows = v.correlation.assign(rho=v.correlation["rho"].where(v.correlation["closure"] != "corrected", 1.2))
    control = replace(evidence, validations=[replace(v, correlation=rows), *evidence.validations[1:]])
    assert of_moments.beyond_one(control).verdict == REPRODUCED


def test_impacts_that_alternate_would_reproduce_the_claim(evidence):
    control = replace(evidence, repeats=dict.fromkeys(("orbit", "noisy"), Mean(0.0, 0.0, 32.0)))
    assert of_motion.counter_meshes(control).verdict == REPRODUCED


@pytest.mark.parametrize(
    ("signs", "verdict"),
    [((-1, 1, -1), REPRODUCED), ((-1, -1, -1), NOT_REPRODUCED), ((1, 1, 1), "holds only for the orbit, which is")],
)
def test_the_range_of_chaos_follows_the_signs(evidence, signs, verdict):
    sweep = evidence.chaos.sweep
    sign = sweep["alpha"].map(dict(zip((0.3, 1.0, 2.0), signs, strict=True)))
    control = sweep.assign(alpha=sweep["alpha"].replace(0.3, 0.1), low=sign - 0.1, high=sign + 0.1)
    chaos = replace(evidence.chaos, sweep=control)
    assert of_motion.chaotic_range(replace(evidence, chaos=chaos)).verdict.startswith(verdict)
    controlled = of_motion.controlled(replace(evidence, chaos=chaos)).verdict
    assert (controlled == REPRODUCED) == (len(set(signs)) == 2)


def test_a_right_mean_map_would_reproduce_the_claim(evidence):
    last = evidence.validations[-1]
    control = replace(last, table=last.table.assign(verdict="accurate"))
    assert (
        of_moments.describes(replace(evidence, validations=[*evidence.validations[:-1], control])).verdict == REPRODUCED
    )


def test_a_mean_map_that_too_few_paths_can_judge_is_undecided(evidence):
    last = evidence.validations[-1]
    control = replace(last, table=last.table.assign(verdict="undecided"))
    assert (
        of_moments.describes(replace(evidence, validations=[*evidence.validations[:-1], control])).verdict == UNDECIDED
    )


def test_a_section_of_few_points_is_not_fuzzy(evidence):
    section = evidence.chaos.sections["orbit"]
    few = np.zeros_like(section.counts)
    few[:, :5, :5] = 100
    chaos = replace(evidence.chaos, sections={**evidence.chaos.sections, "orbit": replace(section, counts=few)})
    assert of_motion.fuzzy(replace(evidence, chaos=chaos)).verdict == NOT_REPRODUCED


@pytest.mark.usefixtures("undrawn")
def test_the_page_holds_every_claim(evidence, claims, tmp_path):
    record = {
        "name": "DAT21", "scene": evidence.scene.to_dict(), "seed": 0, "command": "rattle claims", "commit": "none",
        "versions": {}, "wall_seconds": 1.0,
    }  # fmt: skip
    said = write_claims(tmp_path / "o", list(claims.values()), list(claims), evidence.chaos, record, False)
    assert said[0].startswith("Of 12 testable claims")
    page = read_page(tmp_path / "o" / "page.json")
    figure, overview, words = page.blocks
    assert figure.path == "verdicts.svg"
    assert len(overview.rows) == 12
    assert {"`saltation`", "Lyapunov exponent", "reproduced"} <= dict(words.terms).keys()
    assert [s.title.split(". ", 1)[1] for s in page.sections] == [c.name for c in claims.values()]
    assert pd.read_csv(tmp_path / "o" / "claims.csv")["verdict"].tolist() == [c.verdict for c in claims.values()]
    shown = CliRunner().invoke(main, ["show", str(tmp_path / "o")])
    assert shown.exit_code == 0
    assert all(c.name in shown.output for c in claims.values())


def test_the_answer_counts_the_verdicts_and_names_what_failed(claims):
    chosen = list(claims.values())[:4]
    verdicts = (REPRODUCED, "holds only for the orbit", NOT_REPRODUCED, UNDECIDED)
    said = answer([c._replace(verdict=verdict) for c, verdict in zip(chosen, verdicts, strict=True)])
    assert said == [
        "Of 4 testable claims of the paper 1 is reproduced, 1 holds only in part, 1 is undecided and 1 is not "
        f"reproduced: “{chosen[2].name}”."
    ]
    said = answer([c._replace(verdict=REPRODUCED) for c in chosen])
    assert said == ["Of 4 testable claims of the paper 4 are reproduced."]


def test_the_figure_has_a_row_for_each_claim_and_a_column_for_each_verdict(claims):
    chosen = [c._replace(verdict=verdict) for c, verdict in zip(claims.values(), (REPRODUCED, UNDECIDED), strict=False)]
    (ax,) = verdict_figure(chosen).axes
    assert [tick.get_text() for tick in ax.get_xticklabels()] == ["undecided: 1", "reproduced: 1"]
    assert [(line.get_xdata()[0], line.get_ydata()[0]) for line in ax.lines] == [(1, 0), (0, 1)]


def test_bad_input_of_the_command_is_refused_before_any_work(tmp_path):
    for words in (["--paths", "10"], ["--over", "1:0:3"], ["--sigma", "-1"], ["--impacts", "5"]):
        found = CliRunner().invoke(main, ["claims", *words, "--out", str(tmp_path / "o")])
        assert found.exit_code == 2
        assert words[0][2:] in found.output
