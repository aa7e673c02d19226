"""Small matrices against LAPACK."""

import numpy as np
import pytest

from rattle.scene.linear_algebra import eigen


def test_small_eigenvalues_keep_their_relative_accuracy():
    sizes = np.array([1e-6, 1e-12, 1.0])
    correlation = np.array([[1.0, 0.3, 0.2], [0.3, 1.0, -0.4], [0.2, -0.4, 1.0]])
    others = correlation[np.ix_([0, 2], [0, 2])]
    smallest = sizes[1] ** 2 * (1.0 - correlation[1, [0, 2]] @ np.linalg.solve(others, correlation[[0, 2], 1]))
    matrix = sizes[:, None] * correlation * sizes
    assert eigen(matrix)[0][0] == pytest.approx(smallest, rel=1e-10, abs=0.0)
    assert np.linalg.eigvalsh(matrix)[0] != pytest.approx(smallest, rel=0.1, abs=0.0)
