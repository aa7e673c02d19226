"""The paper's claims on moments, on the motion, its chaos and spectra, one function each: the
verdict, and the numbers that the texts show as evidence.

Which of the published rules at impacts breaks the moments of which stage: Eq. 15 and Eq. 17, each
mended alone.  The second moments of stage 2 follow Eq. 15 alone, those of stage 1 Eq. 17, which
takes the moments of stage 2 away from them: ``lambda - kappa m``.  Both are followed along the
impact times of the published map.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple, TypeAlias

import numpy as np
import pandas as pd
from jinja2 import Environment, StrictUndefined

from rattle.closure import mean_map
from rattle.closure.published import after_flight, after_impact, last_wheel_alone
from rattle.compare.chaos.exponents import NOISY_PATH, ORBIT, Exponents, say_crossings
from rattle.compare.chaos.measure import CLAIMED
from rattle.compare.chaos.record import STICKS_AT_TIMES, STICKS_FOR_GOOD, STICKS_OFTEN
from rattle.compare.chaos.section import NOISY
from rattle.compare.chaos.spectrum import VELOCITY_IN_TIME, spectra_tables
from rattle.compare.checks.claims.evidence import Evidence
from rattle.compare.judge.verdict import Verdict
from rattle.compare.report.json_text import Facts
from rattle.compare.report.texts import join_words, read_texts
from rattle.compare.validation.comparison import rows_to_judge
from rattle.compare.validation.errors import SIMULATED, first_failure
from rattle.montecarlo.statistics.intervals import widest
from rattle.scene import Floats, Scene
from rattle.scene.flight import noise_covariance
from rattle.scene.moments import correlation, realizability

REPRODUCED = "reproduced"
NOT_REPRODUCED = "not reproduced"
CLAIM_UNDECIDED = Verdict.UNDECIDED
HOLDS_ONLY = "holds only for {}"
HOLDS_IN_PART = "holds in part"
Judged: TypeAlias = tuple[str, Facts]
"""A verdict, and what the texts of the claim show."""


class PaperClaim(NamedTuple):
    """A claim of the paper with its test, evidence and verdict."""

    name: str  # short title
    where: str  # place in the paper
    says: str  # the claim itself, in the paper's own words; ``…`` stands for words left out
    test: str  # what is measured, and the result for which the claim counts as reproduced
    evidence: str  # the measured numbers, with their intervals
    verdict: str  # ``reproduced``, ``not reproduced``, ``holds only for ...`` or ``undecided``

    @property
    def kind(self) -> str:
        """The kind of its verdict: `REPRODUCED`, `NOT_REPRODUCED`, `CLAIM_UNDECIDED` or
        `HOLDS_IN_PART`.
        """
        return HOLDS_IN_PART if self.verdict.startswith(HOLDS_ONLY.format("")) else self.verdict


CLAIM_TEXTS = read_texts("checks.claims")
"""What is said of each claim, by the name of the function that judges it, in the order of the
paper."""
TEMPLATES = Environment(undefined=StrictUndefined)
TEMPLATES.filters["join_words"] = join_words


def judge(evidence: Evidence) -> list[PaperClaim]:
    """Judge all claims, in the order of the paper."""
    return [judge_claim(name, evidence) for name in CLAIM_TEXTS]


def judge_claim(name: str, evidence: Evidence) -> PaperClaim:
    """Judge the claim of this name."""
    verdict, shown = globals()[name](evidence)
    texts = (CLAIM_TEXTS[name][part] for part in PaperClaim._fields[:-1])
    rendered = [TEMPLATES.from_string(text).render(shown) for text in texts]
    return PaperClaim._make([*rendered, verdict])


def judge_parts(holding: list[str], parts: int, otherwise: str = NOT_REPRODUCED) -> str:
    """The verdict on a claim that is shown to hold for some of the parts that it is on; `otherwise`
    if for none."""
    if len(holding) == parts:
        return REPRODUCED
    return HOLDS_ONLY.format("; ".join(holding)) if holding else otherwise


AS_PUBLISHED = "as published"
MEND_15 = "Eq. 15 mended"
MEND_17 = "Eq. 17 mended"
MEND_BOTH = "both mended"
FOLLOWED = 12  # impacts
FUZZY = 0.05  # smallest share of the noisy section's bins that a fuzzy set fills
FINITE = 100  # largest number of bins that a periodic orbit of moderate length fills


class Failure(NamedTuple):
    """Where the second moments of a stage are not realizable first."""

    stage: int
    impact: int  # 0 if they do not fail
    reason: str  # what is wrong with them; empty if nothing is

    def __str__(self) -> str:
        if not self.impact:
            return f"stage {self.stage} does not fail"
        return f"stage {self.stage} fails at impact {self.impact} ({self.reason})"


def _strike(scene: Scene, raw: Floats, rule: str) -> Floats:
    """Second moments ``E[xi^n zeta^p]`` of both stages after an impact; first moments are zero."""
    after = after_impact(scene.constants, raw)
    if rule in (MEND_15, MEND_BOTH):
        after[1, 0, 2] = scene.epsilon**2 * raw[1, 0, 2]
    if rule in (MEND_17, MEND_BOTH):  # stages independent of each other, as the paper assumes
        kappa = (1.0 + scene.epsilon) * scene.mu
        after[0, 1, 1] = raw[0, 1, 1]
        after[0, 0, 2] = raw[0, 0, 2] + kappa**2 * raw[1, 0, 2]
    return after


def failures(scene: Scene) -> dict[str, list[Failure]]:
    """Follow the second moments of both stages by the published rules and with one of them, or
    both, mended.

    Returns: By `AS_PUBLISHED`, `MEND_15`, `MEND_17` and `MEND_BOTH`: of stage 1 and of stage 2, the
    first to fail first.
    """
    tau = mean_map(scene, impacts=FOLLOWED, closure="published").trace.tau
    c = scene.constants
    alone = last_wheel_alone(c)
    tau = tau[np.isfinite(tau)]
    by_rule = {}
    for rule in (AS_PUBLISHED, MEND_15, MEND_17, MEND_BOTH):
        raw = np.array([np.diag([1.0, 0.0, 0.0])] * 2)
        first = {stage: Failure(stage, 0, "") for stage in (1, 2)}
        for impact, (start, t) in enumerate(zip(tau, np.diff(tau), strict=False), start=1):
            raw[0] = after_flight(raw[0], scene.beta1, t, noise_covariance(c, start, t))
            raw[1] = after_flight(raw[1], scene.beta2, t, noise_covariance(alone, start, t))
            for stage, m in enumerate(raw, start=1):
                judged = realizability(np.array([[m[2, 0], m[1, 1]], [m[1, 1], m[0, 2]]]))
                if not judged.realizable and not first[stage].impact:
                    first[stage] = Failure(stage, impact, judged.reason)
            raw = _strike(scene, raw, rule)
        by_rule[rule] = sorted(first.values(), key=lambda f: f.impact or FOLLOWED + 1)
    return by_rule


def solvable(e: Evidence) -> Judged:
    """Judge section 3: the equation of the flight cannot be solved exactly."""
    c = e.open_space.constants
    tau = e.open_space.start.tau
    fixed = e.flight.at_times()
    worst = 0.0
    for time, row in fixed.iterrows():
        q = noise_covariance(c, tau, float(time) - tau)  # type: ignore[arg-type]
        for stage in (1, 2):
            xy = slice(2 * stage - 2, 2 * stage)
            rho = row[f"rho{stage}"]
            step_bias = abs(row[f"coarse_rho{stage}"] - rho)
            # Fisher's z
            error = abs(np.arctanh(rho) - np.arctanh(correlation(q[xy, xy])))
            beyond = (error - step_bias / (1.0 - rho**2)) / row[f"se_z_rho{stage}"]
            worst = max(worst, beyond)
    allowed = widest(2 * len(fixed))
    verdict = NOT_REPRODUCED if worst <= allowed else CLAIM_UNDECIDED
    return verdict, {
        "paths": e.flight.paths,
        "times": len(fixed),
        "worst": worst,
        "allowed": allowed,
    }


def beyond_one(e: Evidence) -> Judged:
    """Judge section 3: the correlation exceeds 1, so the distribution is not Gaussian."""
    rows = []
    only_published = True
    for v in e.validations:
        largest = v.correlation["rho"].abs().groupby(v.correlation["closure"]).max()
        corrected, simulated = largest[["corrected", SIMULATED]]
        only_published &= bool(corrected <= 1.0 and simulated <= 1.0)
        failed = first_failure(v.correlation, "published")
        rows.append((v.scene.sigma, failed, corrected, simulated))
    by_rule = failures(e.validations[-1].scene)
    # with one equation alone as published
    first = {17: by_rule[MEND_15][0], 15: by_rule[MEND_17][0]}
    guilty = [
        f"Eq. {equation} alone breaks stage {f.stage} at impact {f.impact}"
        for equation, f in first.items()
        if f.impact
    ]
    only = HOLDS_ONLY.format(f"the published rules at impacts: {join_words(guilty)}")
    verdict = only if only_published else REPRODUCED
    return verdict, {"rows": rows, "rules": by_rule}


def not_gaussian(e: Evidence) -> Judged:
    """Judge section 3: the perturbation's distribution is not Gaussian (at the impacts)."""
    z = widest(sum(len(v.run.section) for v in e.validations))
    rows = []
    for v in e.validations:
        skew, se = v.run.section[["skew_tau", "se_skew_tau"]].to_numpy(float).T
        worst = np.abs(skew).argmax()
        beyond = (np.abs(skew) > z * se).sum()
        rows.append((v.scene.sigma, beyond, len(skew), skew[worst], 1.96 * se[worst]))
    shown = any(beyond for _, beyond, *_ in rows)
    return REPRODUCED if shown else CLAIM_UNDECIDED, {"rows": rows, "z": z}


def stages_apart(e: Evidence) -> Judged:
    """Judge section 3: the perturbations of the two stages are independent of each other."""
    rows = []
    for v in e.validations:
        columns = ["cov_y1_y2", "se_cov_y1_y2", "cov_y1_y1", "cov_y2_y2"]
        covariance, se, variance1, variance2 = v.run.at_times()[columns].to_numpy(float).T
        rho = covariance / np.sqrt(variance1 * variance2)
        beyond = (np.abs(covariance) > widest(len(rho)) * se).sum()
        rows.append((v.scene.sigma, beyond, len(rho), rho[np.abs(rho).argmax()]))
    coupled = any(beyond for _, beyond, *_ in rows)
    return NOT_REPRODUCED if coupled else CLAIM_UNDECIDED, {"rows": rows}


def describes(e: Evidence) -> Judged:
    """Judge section 5: the mean map describes the noisy system."""
    verdicts = {
        closure: [rows_to_judge(v, closure)["verdict"] for v in e.validations]
        for closure in e.validations[0].predictions
    }
    noise = [v.scene.sigma for v in e.validations]
    shares = {
        closure: [
            ((kinds == Verdict.ACCURATE).mean(), s) for kinds, s in zip(at, noise, strict=True)
        ]
        for closure, at in verdicts.items()
    }
    accurate = ", ".join(closure for closure, by_noise in shares.items() if by_noise[0][0] == 1.0)
    paper = [set(verdicts[closure][-1]) for closure in ("published", "corrected")]
    verdict = NOT_REPRODUCED
    if {Verdict.ACCURATE} in paper:
        verdict = REPRODUCED
    elif any(kinds <= {Verdict.ACCURATE, CLAIM_UNDECIDED} for kinds in paper):
        verdict = CLAIM_UNDECIDED
    elif accurate:
        verdict = HOLDS_ONLY.format(
            f"closures right to first order ({accurate}), at σ = {noise[0]:.3g}"
        )
    return verdict, {"shares": shares}


def counter_meshes(e: Evidence) -> Judged:
    """Judge section 4: consecutive impacts are at counter meshes."""
    none = all(share.value - share.half <= 0.0 for share in e.repeats.values())
    return REPRODUCED if none else NOT_REPRODUCED, dict(e.repeats)


def fuzzy(e: Evidence) -> Judged:
    """Judge Fig. 2: the mean Poincaré map is a fuzzy set of points."""
    counts = {side: section.counts[0] for side, section in e.chaos.sections.items()}
    filled = {side: (bins > 0).sum() for side, bins in counts.items()}
    orbit = filled.get("orbit", 0)
    verdict = CLAIM_UNDECIDED if orbit > FINITE else NOT_REPRODUCED
    if orbit > max(FINITE, FUZZY * filled["noisy system"]):
        verdict = HOLDS_ONLY.format(
            "the orbit under the corrected map; the published map ends before it has a section"
        )
    return verdict, {
        "rows": [(side, filled[side], bins.size) for side, bins in counts.items()],
        "published": e.chaos.maps.set_index("closure").loc["published"].to_dict(),
        "finite": FINITE,
        "fuzzy": FUZZY,
    }


class Signs(NamedTuple):
    """A sweep of the orbit, or of the drift along noisy paths, and where the largest exponent has
    either sign."""

    of: str
    rows: pd.DataFrame
    positive: pd.Series
    negative: pd.Series

    def sticks(self, *regimes: str) -> pd.Series:
        """Where the orbit sticks in one of these ways."""
        return self.rows["regime"].isin(regimes)


def _sweeps(e: Evidence) -> Iterator[Signs]:
    """Orbit and drift along noisy paths over the sweep."""
    assert e.chaos.sweep is not None
    for of in (ORBIT, NOISY_PATH):
        rows = e.chaos.sweep[e.chaos.sweep["of"] == of]
        yield Signs(of, rows, rows["low"] > 0.0, rows["high"] < 0.0)


def chaotic_range(e: Evidence) -> Judged:
    """Judge Fig. 4: the largest exponent is positive for 0.2 <= alpha <= 1.7."""
    shown = []
    chaotic: list[str] = []  # systems with positive exponents throughout the range
    for s in _sweeps(e):
        inside = s.rows["alpha"].between(*CLAIMED)
        at_times = s.positive[s.sticks(STICKS_AT_TIMES)]
        without = {kind: s.sticks(kind).sum() for kind in (STICKS_OFTEN, STICKS_FOR_GOOD)}
        shown.append(
            {
                "of": s.of,
                "inside": inside.sum(),
                "outside": (~inside).sum(),
                "positive_inside": s.positive[inside].sum(),
                "positive_outside": s.positive[~inside].sum(),
                "negative_inside": s.negative[inside].sum(),
                "negative_outside": s.negative[~inside].sum(),
                "at_times": len(at_times),
                "positive_at_times": at_times.sum(),
                "without": {kind: number for kind, number in without.items() if number},
                "changes": say_crossings(s.rows, "alpha", s.of),
            }
        )
        if s.positive[inside].all():
            chaotic.append(f"the {s.of}")
    return judge_parts(chaotic, 2), {"systems": shown}


def control(e: Evidence) -> Judged:
    """Judge section 5: chaos can be controlled by a parameter."""
    shown = []
    both_signs: list[str] = []
    sticks = False
    for s in _sweeps(e):
        sticking = s.sticks(STICKS_OFTEN, STICKS_FOR_GOOD).sum()
        shown.append((s.of, s.positive.sum(), s.negative.sum(), sticking, len(s.rows)))
        if s.positive.any() and s.negative.any():
            both_signs.append(f"the {s.of}")
        sticks |= bool(s.positive.any() and sticking)
    transition = (
        HOLDS_ONLY.format("the transition from sticking to chaos") if sticks else CLAIM_UNDECIDED
    )
    return judge_parts(both_signs, 2, transition), {"systems": shown}


def both_models(e: Evidence) -> Judged:
    """Judge section 5: the single-stage model and the two-stage model both show random chaos."""
    exponents: dict[str, Exponents] = {
        "single stage, orbit": e.single["orbit"],
        "single stage, along noisy paths": e.single["noisy"],
        "two stages, orbit": e.chaos.orbit,
        "two stages, along noisy paths": e.chaos.drift,
    }
    chaotic = [name for name, x in exponents.items() if x.largest[1] > 0.0]
    return judge_parts(chaotic, len(exponents)), {"exponents": exponents}


def narrow_bands(e: Evidence) -> Judged:
    """Judge Fig. 3: narrow-band spectra."""
    return _judge_spectra(e, lambda rows: rows["narrow"] > 0, e.mean.periodic)


def continuous(e: Evidence) -> Judged:
    """Judge section 5: continuous spectra."""
    return _judge_spectra(e, lambda rows: rows["floor_share"] > 0.5, not e.mean.periodic)


def _judge_spectra(e: Evidence, has: Callable[[pd.DataFrame], pd.Series], mean_has: bool) -> Judged:
    """Judge a claim on the mean velocity of the published map: which of orbit, single paths and
    their mean show it."""
    summary = spectra_tables(e.chaos.spectra)[2]
    rows = summary[summary["kind"] == VELOCITY_IN_TIME]
    shows = has(rows).groupby(rows["side"], sort=False).all()
    showing = [
        "single noisy paths" if side == NOISY else f"the {side}" for side in shows.index[shows]
    ]
    showing += ["the ensemble's mean"] if mean_has else []
    (published,) = e.chaos.maps[e.chaos.maps["closure"] == "published"].to_dict("records")
    ended = bool(published["ends"] < published["followed"])
    if not showing:
        verdict = NOT_REPRODUCED if ended else CLAIM_UNDECIDED
    elif not ended and len(showing) > len(shows):
        verdict = REPRODUCED
    else:
        clause = "; the published map ends before it has a spectrum" if ended else ""
        verdict = HOLDS_ONLY.format(f"{join_words(showing)}{clause}")
    return verdict, {
        "ends": published["ends"] if ended else None,
        "mean": e.mean,
        "rows": rows.to_dict("records"),
    }
