"""The oracle itself, for three wheels: Newton's laws at an impact and in contact."""

import numpy as np
import pytest
from oracle import Gearbox, Wheel

MASSES = np.array([1.3, 0.4, 0.8])
RATIOS = (1.0, 0.7, 1.6)
TREES = {"chain": (0, 1, 2), "two wheels on one": (0, 1, 1), "two on the driver": (0, 0, 2)}


def gearbox(parents, epsilon=0.6):
    wheels = [
        Wheel(0.1 * (i + 1), 0.3 - 0.1 * i, 1.0 / MASSES[i], 0.5, parent, ratio, sign, epsilon)
        for i, (parent, ratio, sign) in enumerate(zip(parents, RATIOS, (1, -1, 1), strict=True))
    ]
    return Gearbox(wheels, alpha=1.2, sigma=0.3)


@pytest.mark.parametrize("name", TREES)
def test_an_impact_obeys_newton_and_conserves_energy_where_it_is_elastic(name):
    parents = TREES[name]
    speeds = np.array([0.7, -1.1, 0.4])  # of the wheels, each at its own mesh
    for epsilon in (0.6, 1.0):
        box = gearbox(parents, epsilon)
        before = box.to_gaps @ speeds
        for mesh in (1, 2, 3):
            after = (box.restitution(mesh) @ np.kron(before, [0.0, 1.0]))[1::2]
            assert after[mesh - 1] == pytest.approx(-epsilon * before[mesh - 1])
            change = np.linalg.solve(box.to_gaps, after - before)
            impulse = MASSES[mesh - 1] * change[mesh - 1]
            expected = np.zeros(3)
            expected[mesh - 1] = impulse / MASSES[mesh - 1]
            if parent := parents[mesh - 1]:
                expected[parent - 1] = -RATIOS[mesh - 1] * impulse / MASSES[parent - 1]
            assert change == pytest.approx(expected)
            energy = 0.5 * MASSES @ ((speeds + change) ** 2 - speeds**2)
            assert energy == pytest.approx(0.0) if epsilon == 1.0 else energy < 0.0
