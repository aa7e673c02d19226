"""What a validation says in words: the answer in a few sentences, and the paper's argument about rho judged."""

import math
from collections.abc import Iterable, Sequence

import pandas as pd

from rattle.closure import refusals
from rattle.compare.validation.correlation import SIMULATED, first_failure
from rattle.compare.validation.validate import Validation
from rattle.compare.validation.validity_range import in_words, listed, unbroken
from rattle.compare.validation.verdict import JUDGED
from rattle.scene.scene import Scene

__all__ = ["answer", "correlation_claim", "frontier_sentence", "left_out", "sigma_text"]


def sigma_text(v: Validation) -> str:
    """The noise intensity of a validation, as it is written in the report."""
    return f"{v.scene.sigma:.4g}"


def _largest_rho(validations: Sequence[Validation], reading: str) -> float:
    rows = (v.correlation[v.correlation["reading"] == reading]["rho"].abs().max() for v in validations)
    return max((float(r) for r in rows if r == r), default=0.0)


def frontier_sentence(frontier: pd.DataFrame, impacts: int) -> str:
    """Up to which noise intensity each reading gets every impact right, in the words of
    `rattle.compare.validation.validity_range`.
    """
    found: dict[str, list[str]] = {}  # readings by what is said of them
    for reading, rows in frontier.groupby("reading", sort=False):
        at = rows.sort_values("sigma").set_index("sigma")
        accurate, not_wrong = (
            unbroken(at.index, at[name] == impacts) or math.nan for name in ("accurate", "not_refuted")
        )
        ended = bool((at[at["not_refuted"] < impacts]["cause"][:1] == "ended").any())
        found.setdefault(in_words("σ", list(at.index), accurate, not_wrong, ended=ended), []).append(str(reading))
    shares = [f"{listed(readings)}: {said}" for said, readings in found.items()]
    sigmas = frontier["sigma"]
    return (
        f"Every section mean and sd over {impacts} impacts ({sigmas.nunique()} noise intensities from "
        f"{sigmas.min():.4g} to {sigmas.max():.4g}) — {'; '.join(shares)}."
    )


def left_out(scene: Scene, shown: Iterable[str]) -> list[str]:
    """Which readings cannot take a scene, and why: a sentence, or none if no other than those `shown` are missing.

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene, Start
    >>> left_out(Scene.from_gears(DAT21, start=Start()), ["mended", "saltation"])
    ['Left out: printed (start.mesh = 0: the printed reading needs a start at mesh 1 (Eq. 10)).']
    """
    missing = [f"{name} ({why})" for name, why in refusals(scene).items() if name not in shown]
    return [f"Left out: {listed(missing)}."] if missing else []


def answer(validations: Sequence[Validation], frontier: pd.DataFrame | None = None) -> list[str]:
    """The answer in three sentences: accuracy, realizability, agreement; with frontiers one more, before them.

    Readings that cannot take the scene are named in a last one.
    """
    impacts = len(validations[0].run.section)
    tolerances = validations[0].tolerances
    shares = []
    for v in validations:
        each = []
        for reading in v.closures:
            rows = v.table[(v.table["reading"] == reading) & (v.table["kind"] == "section")]
            said = rows["verdict"].value_counts()
            accurate, _, undecided = (int(said.get(verdict, 0)) for verdict in JUDGED)
            beside = f" ({undecided} undecided)" if undecided else ""
            each.append(f"{reading} {accurate} of {int(said.reindex(list(JUDGED)).sum())}{beside}")
        shares.append(f"at σ = {sigma_text(v)} {listed(each)}")
    broken = []
    for reading in validations[0].closures:
        failures = [(v, f) for v in validations if (f := first_failure(v.correlation, reading))]
        if failures:
            v, (impact, stage, why) = failures[-1]
            broken.append(
                f"the {reading} reading stops being realizable at impact {impact} "
                f"(at σ = {sigma_text(v)}, stage {stage}: {why})"
            )
    sound = [r for r in validations[0].closures if not any(first_failure(v.correlation, r) for v in validations)]
    if sound:
        broken.append(f"the moments of {listed(sound)} stay realizable")
    agreement = []
    for v in validations:
        best = max(v.run.agreement[r].iloc[-1] for r in v.closures)
        agreement.append(f"{best:.1%} at σ = {sigma_text(v)}")
    first = [] if frontier is None else [frontier_sentence(frontier, impacts)]
    return [
        *first,
        f"Section moments that a reading predicts over {impacts} impacts and that are accurate (within "
        f"{tolerances.mean:.0%} of an sd for means and {tolerances.sd:.0%} for sds, interval included): "
        f"{'; '.join(shares)}.",
        f"As for the correlation coefficient, {'; '.join(broken)}; in the simulation |ρ| never exceeds "
        f"{_largest_rho(validations, SIMULATED):.4f}.",
        f"After {impacts} impacts the share of paths that still follow one itinerary of a closure is "
        f"{listed(agreement)}: a closure of a single orbit cannot hold beyond it.",
        *left_out(validations[0].scene, validations[0].closures),
    ]


def correlation_claim(validations: Sequence[Validation]) -> str:
    """The paper's argument that the density is not Gaussian because |rho| may exceed 1, held against the evidence."""
    if "printed" not in validations[0].closures or "mended" not in validations[0].closures:
        return ""
    evidence = []
    for v in validations:
        rows = v.correlation[(v.correlation["reading"] == "printed") & ~v.correlation["realizable"]]
        impacts = sorted(set(rows["impact"]))
        if not impacts:
            evidence.append(f"at σ = {sigma_text(v)} nowhere")
            continue
        beyond = rows["rho"].abs().max()
        excess = f", |ρ| up to {beyond:.3g}" if beyond > 1.0 else ""
        evidence.append(f"at σ = {sigma_text(v)} at {len(impacts)} impacts, the first being {impacts[0]}{excess}")
    return (
        "The paper argues that the density cannot be Gaussian because |ρ| may exceed 1. In the printed reading "
        f"second moments belong to no distribution {'; '.join(evidence)}. The rule behind it is Eq. 15, −ε m_np for "
        "every power p, which gives a variance the sign of −ε; with (−ε)^p and the joint moments, all else alike, the "
        f"mended reading keeps |ρ| ≤ {_largest_rho(validations, 'mended'):.4f}, and the simulation shows "
        f"|ρ| ≤ {_largest_rho(validations, SIMULATED):.4f}. The excess is an artefact of that rule. The densities are "
        "not Gaussian all the same: impacts bend them and part them, as the section histograms show."
    )
