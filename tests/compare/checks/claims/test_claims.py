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
    effort = Effort(points=5_000, impacts=20_000, events=128, width=0.03)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(of_evidence, "CLAIM_IMPACTS", 4)
        patch.setattr(of_evidence, "PATH_STEPS", 500_000)
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


def changed(part, **values):
    """What changes a part of the evidence."""
    return lambda evidence: {part: replace(getattr(evidence, part), **values)}


def correlation_beyond_one(evidence):
    first, *others = evidence.validations
    table = first.correlation
    beyond = table["rho"].where(table["closure"] != "corrected", 1.2)
    return {"validations": [replace(first, correlation=table.assign(rho=beyond)), *others]}


def right_mean_map(evidence):
    *others, last = evidence.validations
    return {"validations": [*others, replace(last, table=last.table.assign(verdict="accurate"))]}


def section_of_few_points(evidence):
    sections = dict(evidence.chaos.sections)
    few = np.zeros_like(sections["orbit"].counts)
    few[:, :5, :5] = 100
    sections["orbit"] = replace(sections["orbit"], counts=few)
    return changed("chaos", sections=sections)(evidence)


def alternating(evidence):
    return {"repeats": dict.fromkeys(("orbit", "noisy"), Mean(0.0, 0.0, 32.0))}


@pytest.mark.parametrize(
    ("name", "control", "verdict"),
    [
        ("solvable", changed("open_space", beta1=0.3), CLAIM_UNDECIDED),
        ("beyond_one", correlation_beyond_one, REPRODUCED),
        ("counter_meshes", alternating, REPRODUCED),
        ("describes", right_mean_map, REPRODUCED),
        ("fuzzy", section_of_few_points, NOT_REPRODUCED),
    ],
)
def test_other_evidence_has_another_verdict(evidence, name, control, verdict):
    assert judge_claim(name, replace(evidence, **control(evidence))).verdict == verdict


@pytest.mark.parametrize(
    ("signs", "verdict"),
    [((-1, 1, -1), REPRODUCED), ((-1, -1, -1), NOT_REPRODUCED), ((1, 1, 1), REPRODUCED)],
)
def test_the_range_of_chaos_follows_the_signs(evidence, signs, verdict):
    sweep = evidence.chaos.sweep
    sign = sweep["alpha"].map(dict(zip((0.3, 1.0, 2.0), signs, strict=True)))
    control = sweep.assign(alpha=sweep["alpha"].replace(0.3, 0.1), low=sign - 0.1, high=sign + 0.1)
    other = replace(evidence, **changed("chaos", sweep=control)(evidence))
    assert judge_claim("chaotic_range", other).verdict.startswith(verdict)
    assert (judge_claim("control", other).verdict == REPRODUCED) == (len(set(signs)) == 2)


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
