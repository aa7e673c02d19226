"""The paper's claims: every verdict can come out either way, and the page says what was found."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scenes import dat21

from rattle.compare.chaos.exponents import Mean
from rattle.compare.chaos.sweep import paper_noise
from rattle.compare.checks.claims import evidence as of_evidence
from rattle.compare.checks.claims import judges
from rattle.compare.checks.claims.evidence import Effort, gather
from rattle.compare.checks.claims.judges import (
    CLAIM_TEXTS,
    CLAIM_UNDECIDED,
    NOT_REPRODUCED,
    REPRODUCED,
    failures,
    judge,
    judge_claim,
)
from rattle.compare.checks.claims.page import make_report
from rattle.compare.report.save import save

pytestmark = pytest.mark.filterwarnings("ignore:.*too short.*")


@pytest.fixture(scope="module")
def evidence():
    effort = Effort(points=5_000, impacts=20_000, events=128)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(of_evidence, "CLAIM_IMPACTS", 6)
        return gather(dat21(), (0.02,), (0.3, 1.0, 2.0), 4000, effort, lambda part: None)


@pytest.fixture(scope="module")
def claims(evidence):
    return dict(zip(CLAIM_TEXTS, judge(evidence), strict=True))


@pytest.mark.parametrize(
    ("name", "verdict"),
    [
        ("solvable", NOT_REPRODUCED),
        (
            "beyond_one",
            (
                "holds only for the published rules at impacts: Eq. 17 alone breaks stage 1 at"
                " impact 2 and"
            ),
        ),
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
    assert judge_claim("solvable", control).verdict == CLAIM_UNDECIDED


def test_a_corrected_correlation_beyond_one_would_reproduce_the_claim(evidence):
    v = evidence.validations[0]
    rows = v.correlation.assign(
        rho=v.correlation["rho"].where(v.correlation["closure"] != "corrected", 1.2)
    )
    control = replace(
        evidence, validations=[replace(v, correlation=rows), *evidence.validations[1:]]
    )
    assert judge_claim("beyond_one", control).verdict == REPRODUCED


def test_impacts_that_alternate_would_reproduce_the_claim(evidence):
    control = replace(evidence, repeats=dict.fromkeys(("orbit", "noisy"), Mean(0.0, 0.0, 32.0)))
    assert judge_claim("counter_meshes", control).verdict == REPRODUCED


@pytest.mark.parametrize(
    ("signs", "verdict"),
    [((-1, 1, -1), REPRODUCED), ((-1, -1, -1), NOT_REPRODUCED), ((1, 1, 1), REPRODUCED)],
)
def test_the_range_of_chaos_follows_the_signs(evidence, signs, verdict):
    sweep = evidence.chaos.sweep
    sign = sweep["alpha"].map(dict(zip((0.3, 1.0, 2.0), signs, strict=True)))
    control = sweep.assign(alpha=sweep["alpha"].replace(0.3, 0.1), low=sign - 0.1, high=sign + 0.1)
    chaos = replace(evidence.chaos, sweep=control)
    assert judge_claim("chaotic_range", replace(evidence, chaos=chaos)).verdict.startswith(verdict)
    controlled = judge_claim("control", replace(evidence, chaos=chaos)).verdict
    assert (controlled == REPRODUCED) == (len(set(signs)) == 2)


def test_alpha_outside_the_range_and_an_orbit_that_sticks_at_times_are_said(evidence):
    """The paper says nothing of alpha outside its range; positive exponents there refute
    nothing."""
    sweep = evidence.chaos.sweep
    positive = sweep.assign(low=0.1, high=0.2, regime="sticks at times")
    found = judge_claim(
        "chaotic_range", replace(evidence, chaos=replace(evidence.chaos, sweep=positive))
    )
    assert found.verdict == REPRODUCED
    assert "of α outside the paper says nothing" in found.test
    sticking = (
        "sticking at times, with the exponent of the motion between, at 3 values, all of them"
        " positive"
    )
    assert sticking in found.evidence


def test_each_rule_at_impacts_breaks_the_stage_that_it_is_for():
    """Eq. 17 breaks stage 1 whether Eq. 15 is mended or not, and the other way round; with both
    nothing fails."""
    found = {rule: {f.stage: f.impact for f in at} for rule, at in failures(dat21(0.01)).items()}
    assert found[judges.AS_PUBLISHED] == {1: 2, 2: 2}
    assert found[judges.MEND_15] == {1: 2, 2: 0}
    assert found[judges.MEND_17] == {1: 0, 2: 2}
    assert found[judges.MEND_BOTH] == {1: 0, 2: 0}


def test_spectra_are_judged_of_the_map_the_ensemble_the_orbit_and_paths_apart(evidence):
    """The published map ends, so the claims on its mean velocity are not reproduced as they
    stand."""
    assert evidence.mean.periodic
    assert evidence.mean.share == pytest.approx((0.018, 0.006), abs=0.01)
    narrow = judge_claim("narrow_bands", evidence)
    continuous = judge_claim("continuous", evidence)
    for claim in (narrow, continuous):
        assert "The published map ends at impact 21 and has no spectrum." in claim.evidence
        assert claim.verdict.endswith("; the published map ends before it has a spectrum")
    assert "the ensemble's mean" in narrow.verdict
    assert "the ensemble's mean" not in continuous.verdict
    drifts = replace(evidence, mean=evidence.mean._replace(largest=9.0))
    assert "the ensemble's mean" in judge_claim("continuous", drifts).verdict
    maps = evidence.chaos.maps.assign(ends=evidence.chaos.maps["followed"])
    goes_on = replace(drifts, chaos=replace(evidence.chaos, maps=maps))
    assert judge_claim("continuous", goes_on).verdict == REPRODUCED


def test_a_mean_that_still_depends_on_the_start_is_not_periodic(monkeypatch):
    scene = paper_noise(dat21())
    monkeypatch.setattr(of_evidence, "EVIDENCE_BURN_IN", 0)
    assert not of_evidence.mean_motion(scene, 2000, 0, 1).periodic


def test_quotation_marks_are_around_the_papers_own_words(claims):
    """The file holds the paper's sentences as they stand; words may be left out where … stands."""
    paper = " ".join((Path(__file__).parent / "sentences.txt").read_text(encoding="utf-8").split())
    for claim in claims.values():
        for words in claim.says.split("…"):
            assert words.strip() in paper, words
        assert "mean Poincaré map displays" not in claim.says


def test_a_right_mean_map_would_reproduce_the_claim(evidence):
    last = evidence.validations[-1]
    control = replace(last, table=last.table.assign(verdict="accurate"))
    assert (
        judge_claim(
            "describes", replace(evidence, validations=[*evidence.validations[:-1], control])
        ).verdict
        == REPRODUCED
    )


def test_a_section_of_few_points_is_not_fuzzy(evidence):
    section = evidence.chaos.sections["orbit"]
    few = np.zeros_like(section.counts)
    few[:, :5, :5] = 100
    chaos = replace(
        evidence.chaos, sections={**evidence.chaos.sections, "orbit": replace(section, counts=few)}
    )
    assert judge_claim("fuzzy", replace(evidence, chaos=chaos)).verdict == NOT_REPRODUCED


@pytest.mark.usefixtures("undrawn")
def test_the_page_holds_every_claim(evidence, claims, tmp_path):
    record = dict.fromkeys(("name", "seed", "command", "commit"), "")
    record |= {"scene": evidence.scene.to_dict(), "versions": {}, "wall_seconds": 1.0}
    report = make_report(list(claims.values()), evidence.chaos, record)
    save(tmp_path / "o", report, overwrite=False)
    assert report.answer[0].startswith("Of 12 testable claims")
    page = (tmp_path / "o" / "claims.md").read_text()
    assert page.index("(verdicts.svg)") < page.index("| 12 |") < page.index("\n## ")
    titles = re.findall(r"^## \d+\\. (.*)$", page, re.MULTILINE)
    assert titles == [c.name for c in claims.values()]
    table = pd.read_csv(tmp_path / "o" / "claims.csv")
    assert table["verdict"].tolist() == [c.verdict for c in claims.values()]
    assert table["evidence"].str.contains(r"\d").all()
