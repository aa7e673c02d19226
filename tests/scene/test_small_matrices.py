"""Small matrices against LAPACK."""

import numpy as np
import pytest

from rattle.scene.linear_algebra import eigen


def test_eigenvectors_are_those_of_lapack():
    rng = np.random.default_rng(5)
    for n in (1, 2, 5, 9):
        for decades in (0.0, 6.0, 12.0):
            root = rng.standard_normal((n, n)) * 10.0 ** rng.uniform(-decades, 0.0, n)
            matrix = root @ root.T
            values, vectors = eigen(matrix)
            scale = np.abs(matrix).max()
            assert np.abs(values - np.linalg.eigvalsh(matrix)).max() < 1e-13 * scale * n
            assert np.abs(vectors * values @ vectors.T - matrix).max() < 1e-13 * scale * n
            assert np.abs(vectors.T @ vectors - np.eye(n)).max() < 1e-13 * n
            assert (np.diff(values) >= 0.0).all()


def test_small_eigenvalues_keep_their_relative_accuracy():
    sizes = np.array([1e-6, 1e-12, 1.0])
    correlation = np.array([[1.0, 0.3, 0.2], [0.3, 1.0, -0.4], [0.2, -0.4, 1.0]])
    others = correlation[np.ix_([0, 2], [0, 2])]
    smallest = sizes[1] ** 2 * (1.0 - correlation[1, [0, 2]] @ np.linalg.solve(others, correlation[[0, 2], 1]))
    matrix = sizes[:, None] * correlation * sizes
    assert eigen(matrix)[0][0] == pytest.approx(smallest, rel=1e-10, abs=0.0)
    assert np.linalg.eigvalsh(matrix)[0] != pytest.approx(smallest, rel=0.1, abs=0.0)
