"""The linearised path as a control variate: its mean and variance are known, and it only ever takes
variance out."""

import numpy as np
import pytest
from limits import agrees
from scenes import FOUR, dat21

from rattle import Sampling, simulate
from rattle.scene import section_names

CONTROLLED = {
    "little noise": dat21(0.01),
    "much noise": dat21(1.2),
    "tree": FOUR.with_sigma(0.03),
}


def columns(scene, control, seed, paths=20_000):
    """Means and sds of a sample, and their standard errors, shape (impacts, moments)."""
    sampling = Sampling(control=control)
    run = simulate(scene, paths=paths, impacts=4, rng=seed, sampling=sampling)
    names = [prefix + q for prefix in ("", "sd_") for q in section_names(len(scene.tree))]
    return (run.section[[start + name for name in names]].to_numpy() for start in ("", "se_"))


@pytest.mark.parametrize("name", CONTROLLED)
def test_controlled_and_plain_estimates_agree_and_the_error_never_grows(name):
    """An error of an sd is divided by the sd, which is estimated anew."""
    scene = CONTROLLED[name]
    plain, se_plain = columns(scene, control=False, seed=1)
    _, se = columns(scene, control=True, seed=1)
    other, se_other = columns(scene, control=True, seed=2)
    varies = se_plain > 1e-5 * scene.sigma  # not struck coordinates
    assert (se[varies] <= 1.03 * se_plain[varies]).all()
    gain = np.median(se_plain[varies] / se[varies])
    assert (gain > 3.0) == (name != "much noise")
    allowed = np.hypot(se_plain, se_other)[varies]
    assert agrees(plain[varies], other[varies], allowed)
    assert not agrees(1.02 * plain[varies], other[varies], allowed)


def test_errors_have_the_size_they_claim():
    """Independent repeats scatter by their standard errors."""
    runs = [columns(dat21(0.05), control=True, seed=s, paths=2048) for s in range(40)]
    values, errors = (np.array(part) for part in zip(*runs, strict=True))
    varies = errors.mean(axis=0) > 1e-6
    ratio = values.std(axis=0, ddof=1)[varies] / errors.mean(axis=0)[varies]
    assert 0.75 < np.median(ratio) < 1.25
