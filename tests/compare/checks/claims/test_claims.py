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
from rattle.compare.checks.claims.evidence import Effort, gather
from rattle.compare.checks.claims.judges import (
    CLAIM_TEXTS,
    CLAIM_UNDECIDED,
    NOT_REPRODUCED,
    REPRODUCED,
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
            "holds only for the published rules at impacts: Eq. 17 alone breaks stage 1 at impact"
            " 2 and Eq. 15 alone breaks stage 2 at impact 2",
        ),
        ("stages_apart", NOT_REPRODUCED),
        ("counter_meshes", NOT_REPRODUCED),
        ("chaotic_range", "holds only for"),
        ("describes", "holds only for closures right to first order"),
    ],
)
def test_verdicts_on_dat21(claims, name, verdict):
    assert claims[name].verdict.startswith(verdict)


def with_chaos(evidence, **values):
    """The evidence with other findings on chaos."""
    return replace(evidence, chaos=replace(evidence.chaos, **values))


def test_other_evidence_has_another_verdict(evidence):
    first, last = evidence.validations
    rho = first.correlation["rho"].where(first.correlation["closure"] != "corrected", 1.2)
    sections = evidence.chaos.sections
    few = np.zeros_like(sections["orbit"].counts)
    few[:, :5, :5] = 100
    orbit = replace(sections["orbit"], counts=few)
    beyond = replace(first, correlation=first.correlation.assign(rho=rho))
    right = replace(last, table=last.table.assign(verdict="accurate"))
    others = {
        "beyond_one": replace(evidence, validations=[beyond, last]),
        "describes": replace(evidence, validations=[first, right]),
        "solvable": replace(evidence, open_space=replace(evidence.open_space, beta1=0.3)),
        "counter_meshes": replace(
            evidence, repeats=dict.fromkeys(evidence.repeats, Mean(0.0, 0.0, 32.0))
        ),
        "fuzzy": with_chaos(evidence, sections=sections | {"orbit": orbit}),
    }
    found = {name: judge_claim(name, other).verdict for name, other in others.items()}
    assert found == dict.fromkeys(others, REPRODUCED) | {
        "solvable": CLAIM_UNDECIDED,
        "fuzzy": NOT_REPRODUCED,
    }


@pytest.mark.parametrize(
    ("signs", "verdict"),
    [((-1, 1, -1), REPRODUCED), ((-1, -1, -1), NOT_REPRODUCED), ((1, 1, 1), REPRODUCED)],
)
def test_the_range_of_chaos_follows_the_signs(evidence, signs, verdict):
    sweep = evidence.chaos.sweep
    sign = sweep["alpha"].map(dict(zip((0.3, 1.0, 2.0), signs, strict=True)))
    other = with_chaos(
        evidence,
        sweep=sweep.assign(alpha=sweep["alpha"].replace(0.3, 0.1), low=sign - 0.1, high=sign + 0.1),
    )
    assert judge_claim("chaotic_range", other).verdict.startswith(verdict)
    assert (judge_claim("control", other).verdict == REPRODUCED) == (len(set(signs)) == 2)


def test_alpha_outside_the_range_and_an_orbit_that_sticks_at_times_are_said(evidence):
    """The paper says nothing of alpha outside its range; positive exponents there refute
    nothing."""
    positive = evidence.chaos.sweep.assign(low=0.1, high=0.2, regime="sticks at times")
    found = judge_claim("chaotic_range", with_chaos(evidence, sweep=positive))
    assert found.verdict == REPRODUCED
    assert "of α outside the paper says nothing" in found.test
    assert (
        "sticking at times, with the exponent of the motion between, at 3 values, all of them"
        " positive" in found.evidence
    )


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
    assert judge_claim("continuous", with_chaos(drifts, maps=maps)).verdict == REPRODUCED


def test_a_mean_that_still_depends_on_the_start_is_not_periodic(monkeypatch):
    monkeypatch.setattr(of_evidence, "EVIDENCE_BURN_IN", 0)
    assert not of_evidence.mean_motion(paper_noise(dat21()), 2000, 0, 1).periodic


def test_quotation_marks_are_around_the_papers_own_words(claims):
    """The file holds the paper's sentences as they stand; words may be left out where … stands."""
    paper = " ".join((Path(__file__).parent / "sentences.txt").read_text().split())
    for claim in claims.values():
        for words in claim.says.split("…"):
            assert words.strip() in paper, words


@pytest.mark.usefixtures("undrawn")
def test_the_page_holds_every_claim(evidence, claims, tmp_path):
    record = dict.fromkeys(("name", "seed", "command", "commit"), "")
    record |= {"scene": evidence.scene.to_dict(), "versions": {}, "wall_seconds": 1.0}
    report = make_report(list(claims.values()), evidence.chaos, record)
    save(tmp_path / "o", report, overwrite=False)
    assert report.answer[0].startswith("Of 12 testable claims")
    page = (tmp_path / "o/claims.md").read_text()
    assert page.index("(verdicts.svg)") < page.index("| 12 |") < page.index("\n## ")
    table = pd.read_csv(tmp_path / "o/claims.csv")
    assert re.findall(r"^## \d+\\. (.*)$", page, re.MULTILINE) == [c.name for c in claims.values()]
    assert table["verdict"].tolist() == [c.verdict for c in claims.values()]
    assert table["evidence"].str.contains(r"\d").all()
