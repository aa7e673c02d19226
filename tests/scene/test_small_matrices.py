"""Small matrices against LAPACK."""

import numpy as np
import pytest

from rattle.scene.small_matrices import eigen


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
    sizes = np.array([1.0, 1e-5, 1e-10])
    correlation = np.array([[1.0, 0.3, 0.2], [0.3, 1.0, -0.4], [0.2, -0.4, 1.0]])
    matrix = sizes[:, None] * correlation * sizes
    schur = matrix[2, 2] - matrix[2, :2] @ np.linalg.solve(
        correlation[:2, :2] * sizes[:2, None] * sizes[:2], matrix[:2, 2]
    )
    assert eigen(matrix)[0][0] == pytest.approx(schur, rel=1e-9, abs=0.0)
    assert np.linalg.eigvalsh(matrix)[0] != pytest.approx(schur, rel=1e-9, abs=0.0)
