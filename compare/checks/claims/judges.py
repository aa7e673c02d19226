"""The paper's claims on moments, on the motion, its chaos and spectra, one function each: test,
evidence, verdict.

Which of the published rules at impacts breaks the moments of which stage: Eq. 15 and Eq. 17, each
mended alone.  The second moments of stage 2 follow Eq. 15 alone, those of stage 1 Eq. 17, which
takes the moments of stage 2 away from them: ``lambda - kappa m``.  Both are followed along the
impact times of the published map.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from rattle.closure import mean_map
from rattle.closure.published import after_flight, plain_covariance
from rattle.compare.chaos.exponents import DRIFT, ORBIT, Exponents, say_crossings
from rattle.compare.chaos.measure import CLAIMED
from rattle.compare.chaos.record import STICKS_AT_TIMES, STICKS_FOR_GOOD, STICKS_OFTEN
from rattle.compare.chaos.section import NOISY
from rattle.compare.chaos.spectrum import VELOCITY_IN_TIME, spectra_tables
from rattle.compare.checks.claims.evidence import Evidence
from rattle.compare.report.texts import read_texts
from rattle.compare.validation.comparison import Comparison, rows_to_judge
from rattle.compare.validation.errors import SIMULATED, first_failure
from rattle.compare.validation.verdict import Verdict, join_words
from rattle.montecarlo.statistics.intervals import widest
from rattle.scene import Floats, Scene
from rattle.scene.flight import noise_covariance
from rattle.scene.moments import correlation, realizability

REPRODUCED = "reproduced"
NOT_REPRODUCED = "not reproduced"
CLAIM_UNDECIDED = Verdict.UNDECIDED
HOLDS_ONLY = "holds only for {}"
HOLDS_IN_PART = "holds in part"


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


def claim(judged: str, verdict: str, **found: Any) -> PaperClaim:
    """A judged claim; `found` is what its texts say."""
    return PaperClaim._make(
        [*(CLAIM_TEXTS[judged][part].format(**found) for part in PaperClaim._fields[:5]), verdict]
    )


def judge_parts(found: list[str], sought: int, otherwise: str = NOT_REPRODUCED) -> str:
    """The verdict on a claim that is shown to hold for some of the parts that it is on; `otherwise`
    if for none."""
    if len(found) == sought:
        return REPRODUCED
    return HOLDS_ONLY.format("; ".join(found)) if found else otherwise


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


def _struck(scene: Scene, stage1: Floats, stage2: Floats, rule: str) -> tuple[Floats, Floats]:
    """Second moments ``E[xi^n zeta^p]`` of both stages after an impact; first moments are zero."""
    kappa = (1.0 + scene.epsilon) * scene.mu
    e = scene.epsilon
    one = stage1.copy()
    two = stage2.copy()
    two[1, 1] = -e * stage2[1, 1]
    two[0, 2] = (e**2 if rule in (MEND_15, MEND_BOTH) else -e) * stage2[0, 2]
    if rule in (MEND_17, MEND_BOTH):  # stages independent of each other, as the paper assumes
        one[0, 2] = stage1[0, 2] + kappa**2 * stage2[0, 2]
    else:
        one[1, 1] = stage1[1, 1] - kappa * stage2[1, 1]
        one[0, 2] = stage1[0, 2] - kappa * stage2[0, 2]
    return one, two


def failures(scene: Scene) -> dict[str, list[Failure]]:
    """Follow the second moments of both stages by the published rules and with one of them, or
    both, mended.

    Returns: By `AS_PUBLISHED`, `MEND_15`, `MEND_17` and `MEND_BOTH`: of stage 1 and of stage 2, the
    first to fail first.
    """
    tau = mean_map(scene, impacts=FOLLOWED, closure="published").trace.tau
    c = scene.constants
    tau = tau[np.isfinite(tau)]
    found = {}
    for rule in (AS_PUBLISHED, MEND_15, MEND_17, MEND_BOTH):
        one = two = np.diag([1.0, 0.0, 0.0])
        first = {stage: Failure(stage, 0, "") for stage in (1, 2)}
        for impact, (start, t) in enumerate(zip(tau, np.diff(tau), strict=False), start=1):
            one = after_flight(one, c.beta1, t, noise_covariance(c, start, t))
            two = after_flight(two, c.beta2, t, plain_covariance(c.beta2, c.sigma, t))
            for stage, raw in ((1, one), (2, two)):
                moments = realizability(np.array([[raw[2, 0], raw[1, 1]], [raw[1, 1], raw[0, 2]]]))
                if not moments.realizable and not first[stage].impact:
                    first[stage] = Failure(stage, impact, moments.reason)
            one, two = _struck(scene, one, two, rule)
        found[rule] = sorted(first.values(), key=lambda f: f.impact or FOLLOWED + 1)
    return found


def judge(evidence: Evidence) -> list[PaperClaim]:
    """Judge all claims, in the order of the paper."""
    return [globals()[name](evidence) for name in CLAIM_TEXTS]


def _at(v: Comparison) -> str:
    return f"σ = {v.scene.sigma:.3g}"


def solvable(e: Evidence) -> PaperClaim:
    """Judge section 3: the equation of the flight cannot be solved exactly."""
    c = e.open_space.constants
    tau = e.open_space.start.tau
    fixed = e.flight.at_times()
    worst = 0.0
    for time, row in fixed.iterrows():
        q = noise_covariance(c, tau, float(time) - tau)  # type: ignore[arg-type]
        for stage in (1, 2):
            j = 2 * stage - 2
            rho = row[f"rho{stage}"]
            step_bias = abs(row[f"coarse_rho{stage}"] - row[f"rho{stage}"])
            # Fisher's z
            error = abs(np.arctanh(rho) - np.arctanh(correlation(q[j : j + 2, j : j + 2])))
            worst = max(
                worst, float((error - step_bias / (1.0 - rho**2)) / row[f"se_z_rho{stage}"])
            )
    allowed = widest(2 * len(fixed))
    verdict = NOT_REPRODUCED if worst <= allowed else CLAIM_UNDECIDED
    return claim(
        "solvable", verdict, paths=e.flight.paths, times=len(fixed), worst=worst, allowed=allowed
    )


def beyond_one(e: Evidence) -> PaperClaim:
    """Judge section 3: the correlation exceeds 1, so the distribution is not Gaussian."""
    shown = []
    only_published = True
    for v in e.validations:
        most = v.correlation["rho"].abs().groupby(v.correlation["closure"]).max()
        failed = first_failure(v.correlation, "published")
        published = (
            f"published fails at impact {failed[0]} ({failed[2]})"
            if failed
            else "published does not fail"
        )
        shown.append(
            f"{_at(v)}: {published}, corrected ≤ {most['corrected']:.4f}, simulation ≤"
            f" {most[SIMULATED]:.4f}"
        )
        only_published &= bool((most[["corrected", SIMULATED]] <= 1.0).all())
    by_rule = failures(e.validations[-1].scene)
    rules = "; ".join(
        f"{rule}: {join_words([_describe_failure(f) for f in at])}" for rule, at in by_rule.items()
    )
    # with one equation alone as published
    first = {17: by_rule[MEND_15][0], 15: by_rule[MEND_17][0]}
    guilty = [
        f"Eq. {eq} alone breaks stage {f.stage} at impact {f.impact}"
        for eq, f in first.items()
        if f.impact
    ]
    only = HOLDS_ONLY.format(f"the published rules at impacts: {join_words(guilty)}")
    said = {"shown": "; ".join(shown), "at": _at(e.validations[-1]), "rules": rules}
    return claim("beyond_one", only if only_published else REPRODUCED, **said)


def _describe_failure(f: Failure) -> str:
    return (
        f"stage {f.stage} fails at impact {f.impact} ({f.reason})"
        if f.impact
        else f"stage {f.stage} does not fail"
    )


def not_gaussian(e: Evidence) -> PaperClaim:
    """Judge section 3: the perturbation's distribution is not Gaussian (at the impacts)."""
    shown = []
    beyond = 0
    z = widest(sum(len(v.run.section) for v in e.validations))
    for v in e.validations:
        skew, se = v.run.section[["skew_tau", "se_skew_tau"]].to_numpy(float).T
        worst = int(np.abs(skew).argmax())
        many = int((np.abs(skew) > z * se).sum())
        beyond += many
        shown.append(
            f"{_at(v)}: skewness of τ significantly non-zero at {many} of {len(skew)} impacts,"
            f" largest {skew[worst]:.2f} ± {1.96 * se[worst]:.2f}"
        )
    return claim(
        "not_gaussian", REPRODUCED if beyond else CLAIM_UNDECIDED, shown="; ".join(shown), z=z
    )


def stages_apart(e: Evidence) -> PaperClaim:
    """Judge section 3: the perturbations of the two stages are independent of each other."""
    shown = []
    coupled = 0
    for v in e.validations:
        columns = ["cov_y1_y2", "se_cov_y1_y2", "cov_y1_y1", "cov_y2_y2"]
        covariance, se, variance1, variance2 = v.run.at_times()[columns].to_numpy(float).T
        rho = covariance / np.sqrt(variance1 * variance2)
        many = int((np.abs(covariance) > widest(len(rho)) * se).sum())
        coupled += many
        largest = rho[np.abs(rho).argmax()]
        shown.append(
            f"{_at(v)}: non-zero at {many} of {len(rho)} fixed times, largest {largest:.3f}"
        )
    return claim(
        "stages_apart", NOT_REPRODUCED if coupled else CLAIM_UNDECIDED, shown="; ".join(shown)
    )


def describes(e: Evidence) -> PaperClaim:
    """Judge section 5: the mean map describes the noisy system."""
    shares = {
        r: [
            float((rows_to_judge(v, r)["verdict"] == Verdict.ACCURATE).mean())
            for v in e.validations
        ]
        for r in e.validations[0].predictions
    }
    text = "; ".join(
        f"{closure} "
        + ", ".join(f"{s:.0%} at {_at(v)}" for s, v in zip(each, e.validations, strict=True))
        for closure, each in shares.items()
    )
    accurate = ", ".join(r for r, each in shares.items() if each[0] == 1.0)
    paper = [
        set(rows_to_judge(e.validations[-1], r)["verdict"])
        for r in shares
        if r in ("published", "corrected")
    ]
    verdict = NOT_REPRODUCED
    if any(said == {Verdict.ACCURATE} for said in paper):
        verdict = REPRODUCED
    elif any(said <= {Verdict.ACCURATE, CLAIM_UNDECIDED} for said in paper):
        verdict = CLAIM_UNDECIDED
    elif accurate:
        verdict = HOLDS_ONLY.format(
            f"closures right to first order ({accurate}), at {_at(e.validations[0])}"
        )
    return claim("describes", verdict, shown=text)


def counter_meshes(e: Evidence) -> PaperClaim:
    """Judge section 4: consecutive impacts are at counter meshes."""
    orbit = e.repeats["orbit"]
    noisy = e.repeats["noisy"]
    none = all(m.value - m.half <= 0.0 for m in (orbit, noisy))
    return claim("counter_meshes", REPRODUCED if none else NOT_REPRODUCED, orbit=orbit, noisy=noisy)


def fuzzy(e: Evidence) -> PaperClaim:
    """Judge Fig. 2: the mean Poincaré map is a fuzzy set of points."""
    sections = e.chaos.sections
    filled = {side: int((s.counts[0] > 0).sum()) for side, s in sections.items()}
    orbit = filled.get("orbit", 0)
    noisy = filled["noisy system"]
    published = e.chaos.maps.set_index("closure").loc["published"]
    text = ", ".join(
        f"{side} {n:,} of {sections[side].counts[0].size:,} bins" for side, n in filled.items()
    )
    verdict = CLAIM_UNDECIDED if orbit > FINITE else NOT_REPRODUCED
    if orbit > max(FINITE, FUZZY * noisy):
        verdict = HOLDS_ONLY.format(
            "the orbit under the corrected map; the published map ends before it has a section"
        )
    return claim("fuzzy", verdict, shown=text, published=published, finite=FINITE, fuzzy=FUZZY)


def chaotic_range(e: Evidence) -> PaperClaim:
    """Judge Fig. 4: the largest exponent is positive for 0.2 <= alpha <= 1.7."""
    shown: list[str] = []
    chaotic: list[str] = []  # systems with positive exponents throughout the range
    for of, rows, positive, negative in _systems(e):
        inside = rows["alpha"].between(*CLAIMED)
        shown.append(
            f"{of}: positive at {positive[inside].sum()} of {inside.sum()} values inside and at"
            f" {positive[~inside].sum()} of {(~inside).sum()} outside, negative at"
            f" {negative[inside].sum()} inside and {negative[~inside].sum()}"
            f" outside{_sticking(rows)}; changes of sign: {say_crossings(rows, 'alpha', of)}"
        )
        if positive[inside].all():
            chaotic.append(f"the {of}")
    return claim("chaotic_range", judge_parts(chaotic, 2), shown="; ".join(shown))


def _systems(e: Evidence) -> Iterator[tuple[str, pd.DataFrame, pd.Series, pd.Series]]:
    """Orbit and drift along noisy paths: rows of the sweep, and at which the largest exponent has
    either sign."""
    assert e.chaos.sweep is not None
    for of in (ORBIT, DRIFT):
        rows = e.chaos.sweep[e.chaos.sweep["of"] == of]
        yield of, rows, rows["low"] > 0.0, rows["high"] < 0.0


def _sticking(rows: pd.DataFrame) -> str:
    """Where the orbit sticks, and the sign of the exponent there."""
    said = ""
    positive = rows["low"][rows["regime"] == STICKS_AT_TIMES] > 0.0
    if len(positive):
        signs = "all of them positive" if positive.all() else f"{positive.sum()} positive"
        said = (
            f"; sticking at times, with the exponent of the motion between, at {len(positive)}"
            f" values, {signs}"
        )
    without = {
        kind: int((rows["regime"] == kind).sum()) for kind in (STICKS_OFTEN, STICKS_FOR_GOOD)
    }
    return said + "".join(
        f"; without an exponent, as it {kind}, at {n}" for kind, n in without.items() if n
    )


def both_models(e: Evidence) -> PaperClaim:
    """Judge section 5: the single-stage model and the two-stage model both show random chaos."""
    found = {
        "single stage, orbit": e.single["orbit"],
        "single stage, along noisy paths": e.single["noisy"],
        "two stages, orbit": e.chaos.orbit,
        "two stages, along noisy paths": e.chaos.drift,
    }
    text = "; ".join(f"{name}: {_exponent(x)}" for name, x in found.items())
    chaotic = [name for name, x in found.items() if x.largest[1] > 0.0]
    return claim("both_models", judge_parts(chaotic, len(found)), shown=text)


def _exponent(x: Exponents) -> str:
    value, low, high = x.largest
    return f"{value:.4f} ({low:.4f} to {high:.4f})" if np.isfinite(value) else x.regime.reason


def control(e: Evidence) -> PaperClaim:
    """Judge section 5: chaos can be controlled by a parameter."""
    shown: list[str] = []
    both_signs: list[str] = []
    sticks = False
    for of, rows, positive, negative in _systems(e):
        sticking = rows["regime"].isin((STICKS_OFTEN, STICKS_FOR_GOOD))
        without = (
            f", without an exponent for sticking often or for good at {sticking.sum()}"
            if sticking.any()
            else ""
        )
        counts = f"positive at {positive.sum()}, negative at {negative.sum()}{without}"
        shown.append(f"{of}: {counts} of {len(rows)} values of α")
        if positive.any() and negative.any():
            both_signs.append(f"the {of}")
        sticks |= bool(positive.any() and sticking.any())
    transition = (
        HOLDS_ONLY.format("the transition from sticking to chaos") if sticks else CLAIM_UNDECIDED
    )
    return claim("control", judge_parts(both_signs, 2, transition), shown="; ".join(shown))


def narrow_bands(e: Evidence) -> PaperClaim:
    """Judge Fig. 3: narrow-band spectra."""
    return _judge_spectra(e, "narrow_bands", lambda rows: rows["narrow"] > 0, e.mean.periodic)


def continuous(e: Evidence) -> PaperClaim:
    """Judge section 5: continuous spectra."""
    return _judge_spectra(
        e, "continuous", lambda rows: rows["floor_share"] > 0.5, not e.mean.periodic
    )


def _judge_spectra(
    e: Evidence, judged: str, has: Callable[[pd.DataFrame], Any], mean_has: bool
) -> PaperClaim:
    """Judge a claim on the mean velocity of the published map: which of orbit, single paths and
    their mean show it."""
    summary = spectra_tables(e.chaos.spectra)[2]
    rows = summary[summary["kind"] == VELOCITY_IN_TIME]
    shown = "; ".join(map(CLAIM_TEXTS[judged]["spectrum"].format_map, rows.to_dict("records")))
    shows = has(rows).groupby(rows["side"], sort=False).all()
    found = [
        "single noisy paths" if side == NOISY else f"the {side}" for side in shows.index[shows]
    ]
    found += ["the ensemble's mean"] if mean_has else []
    (published,) = e.chaos.maps[e.chaos.maps["closure"] == "published"].to_dict("records")
    ended = published["ends"] < published["followed"]
    ends = f"ends at impact {published['ends']:g} and has no spectrum"
    said = ends if ended else "does not end; its spectrum is not measured here"
    if not found:
        verdict = NOT_REPRODUCED if ended else CLAIM_UNDECIDED
    elif not ended and len(found) > len(shows):
        verdict = REPRODUCED
    else:
        clause = "; the published map ends before it has a spectrum" if ended else ""
        verdict = HOLDS_ONLY.format(f"{join_words(found)}{clause}")
    share = join_words(
        [
            f"{part:.1%} of the variance of y{stage}"
            for stage, part in enumerate(e.mean.share, start=1)
        ]
    )
    repeats = "does not repeat itself with the excitation"
    if e.mean.periodic:
        lines = "so that its spectrum is lines at multiples of that frequency and nothing between"
        repeats = f"repeats itself with the excitation, {lines}"
    shown = f"{shown[0].upper()}{shown[1:]}"
    return claim(
        judged, verdict, published=said, mean=e.mean, repeats=repeats, share=share, shown=shown
    )
