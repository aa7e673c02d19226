import numpy as np
import pytest

from rattle.scene.moments import realizability


@pytest.mark.parametrize(
    ("covariance", "reason"),
    [
        ([[-1.0, 0.0], [0.0, 1.0]], "variance of x = -1 < 0"),
        ([[1.0, 0.0], [0.0, -0.25]], "variance of y = -0.25 < 0"),
        ([[-1.0, 0.0], [0.0, -2.0]], "variance of x = -1 < 0, variance of y = -2 < 0"),
        ([[1.0, 1.2], [1.2, 1.0]], "|rho| = 1.2 > 1"),
        ([[1.0, -1.2], [-1.2, 1.0]], "|rho| = 1.2 > 1"),
        ([[1e-20, 2e-20], [2e-20, 1e-20]], "|rho| = 2 > 1"),
        ([[0.0, 0.1], [0.1, 1.0]], "smallest eigenvalue"),
        ([[float("nan"), 0.0], [0.0, 1.0]], "not finite"),
        ([[1.0, float("inf")], [float("inf"), 1.0]], "not finite"),
    ],
)
def test_unrealizable_moments_are_named(covariance, reason):
    judged = realizability(np.array(covariance))
    assert not judged.realizable
    assert reason in judged.reason
