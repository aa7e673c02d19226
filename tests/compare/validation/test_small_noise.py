"""At small noise the sds are small, and errors still count in sds: nothing wrong is accurate for
being small."""

from pathlib import Path

import numpy as np
import pytest
from refusals import refusal
from scenes import dat21

from rattle import Sampling, Scene, Tolerances, mean_map, simulate, validate
from rattle.compare.judge.rows import BY_SIZE, NamedSection
from rattle.compare.judge.verdict import JUDGED
from rattle.compare.thresholds.claim import read_claim
from rattle.compare.thresholds.decision import errors_of, predict
from rattle.compare.validation.answer import answer
from rattle.compare.validation.errors import section_errors
from rattle.montecarlo.diagnostics.accuracy import error_bound
from rattle.montecarlo.statistics.intervals import ABSOLUTE, widest

SMALL_NOISE_IMPACTS = 3
NOISELESS = {
    "DAT21": dat21(),
    "one stage": Scene(alpha=14.6, epsilon=0.7, beta1=0.0, gamma1=5.07, stages=1),
}
SMALL_SIGMAS = (1e-9, 1e-3)
Z_OF_SECTION = widest(2 * 6 * SMALL_NOISE_IMPACTS)


def drawn(name, sigma, paths=8192):
    """A scene of this noise, a simulation of it, and the moments of saltation, which is exact in
    this limit."""
    scene = NOISELESS[name].with_sigma(sigma)
    run = simulate(
        scene,
        paths=paths,
        impacts=SMALL_NOISE_IMPACTS,
        sampling=Sampling(control=True),
    )
    return scene, run, mean_map(scene, impacts=SMALL_NOISE_IMPACTS).section


def wrong(section):
    """Planted errors: a mean by a fifth of its sd, an sd three times too large, and one that is
    zero."""
    return section.assign(
        tau=section["tau"] + 0.2 * section["sd_tau"],
        sd_y1=3.0 * section["sd_y1"],
        sd_flight=0.0 * section["sd_flight"],
    )


@pytest.mark.parametrize("sigma", SMALL_SIGMAS)
@pytest.mark.parametrize("name", NOISELESS)
def test_planted_errors_are_inaccurate_at_any_noise(name, sigma):
    _, run, right = drawn(name, sigma)

    def table(section):
        found = section_errors([NamedSection("planted", section)], run, Z_OF_SECTION, Tolerances())
        return found[found["verdict"].isin(JUDGED) & (found["unit"] > 1e-3 * sigma)]

    assert (table(right)["verdict"] == "accurate").all()
    found = table(wrong(right))
    planted = found.set_index(["moment", "quantity"])["verdict"]
    assert (planted[[("mean", "tau"), ("sd", "y1"), ("sd", "flight")]] == "inaccurate").all()
    np.testing.assert_allclose(
        found["tolerance"], found["moment"].map({"mean": 0.05, "sd": 0.10}) * found["unit"]
    )


def test_what_does_not_vary_is_judged_by_its_size_and_says_so():
    scene = NOISELESS["DAT21"]
    v = validate(
        scene,
        impacts=SMALL_NOISE_IMPACTS,
        closures=["saltation", "corrected"],
        paths=1,
    )
    assert set(v.table["kind"]) == {"section", "itinerary"}  # no correlation
    rows = v.table[v.table["verdict"].isin(JUDGED)]
    assert (rows["remark"] == BY_SIZE).all()
    assert (rows["verdict"] == "accurate").all()
    assert (
        f"Moments not measured in sds ({BY_SIZE}): at σ = 0 `saltation` 30 and `corrected` 24."
        in answer([v])
    )
    far = drawn("DAT21", 0.0, paths=1)[2].assign(tau=lambda s: s["tau"] * (1.0 + 2.0 * ABSOLUTE))
    run = simulate(scene, paths=1, impacts=SMALL_NOISE_IMPACTS)
    found = section_errors([NamedSection("planted", far)], run, Z_OF_SECTION, Tolerances())
    assert "inaccurate" in set(found.query("moment == 'mean' and quantity == 'tau'")["verdict"])


@pytest.mark.parametrize("sigma", SMALL_SIGMAS)
def test_an_accuracy_counts_in_sds_at_any_noise(sigma):
    _, run, _ = drawn("DAT21", sigma)
    small = error_bound(run).error
    large = error_bound(drawn("DAT21", 0.01)[1]).error
    assert 0.5 * large < small < 2.0 * large


def test_a_claim_of_the_wall_alone_is_refused():
    scene = dat21(0.02)
    run = simulate(scene, paths=2048, impacts=1)
    claim = read_claim(
        {"scene": scene, "impacts": [1], "quantities": f"x{run.section['mesh'][1]}"}, Path()
    )
    with refusal("none of these rows has a verdict"):
        errors_of(predict("saltation", claim), run, claim)
