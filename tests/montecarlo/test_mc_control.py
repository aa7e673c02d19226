"""The linearised path as a control variate: its mean and variance are known, and it only ever takes
variance out."""

import numpy as np
import pytest
from mc_checks import agrees, dat21

from rattle import Sampling
from rattle.montecarlo import simulate
from rattle.scene import section_names

STEP = np.pi / 64.0


def table(scene, control, seed=1, paths=40_000):
    return simulate(
        scene,
        paths=paths,
        impacts=6,
        dt=STEP,
        scheme="exact-flight",
        rng=seed,
        sampling=Sampling(control=control),
    ).section


def columns(section, prefix):
    return section[[prefix + q for q in section_names(2)]].to_numpy()


@pytest.mark.parametrize("sigma", [0.01, 0.1, 1.2])
def test_controlled_and_plain_estimates_agree_and_the_error_never_grows(sigma):
    scene = dat21(sigma)
    plain = table(scene, False, seed=1)
    controlled = table(scene, True, seed=2)
    for prefix in ("", "sd_"):
        a = columns(plain, prefix)
        b = columns(controlled, prefix)
        ea = columns(plain, "se_" + prefix)
        eb = columns(controlled, "se_" + prefix)
        seen = (ea > 1e-12) & (columns(plain, "sd_") > 1e-3 * sigma)  # not struck coordinates
        assert agrees(a[seen], b[seen], np.hypot(ea[seen], eb[seen]))
        assert not agrees(a[seen] * 1.02, b[seen], np.hypot(ea[seen], eb[seen]))
        same = columns(table(scene, True, seed=1), "se_" + prefix)
        assert (
            same[seen] <= 1.03 * ea[seen]
        ).all()  # an error of an sd is divided by the sd, which is estimated anew


def test_errors_have_the_size_they_claim():
    """Independent repeats scatter by their standard errors."""
    runs = [table(dat21(0.05), True, seed=s, paths=2048) for s in range(40)]
    for prefix in ("", "sd_"):
        values = np.array([columns(r, prefix)[:, [0, 3, 5]] for r in runs])
        errors = np.array([columns(r, "se_" + prefix)[:, [0, 3, 5]] for r in runs])
        ratio = values.std(axis=0, ddof=1) / errors.mean(axis=0)
        assert 0.75 < np.median(ratio) < 1.25
