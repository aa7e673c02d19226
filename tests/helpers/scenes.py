"""Scenes that several folders of tests share."""

import numpy as np

from rattle.scene import DAT21, Order, Scene, Start, Wheel

STICKING = {
    "one stage": Scene(alpha=1.0, epsilon=0.3, beta1=0.05, gamma1=0.8, stages=1),
    "mesh 1": Scene(alpha=0.3, epsilon=0.3, beta1=0.1, beta2=0.3, gamma1=0.3, gamma2=0.1, mu=0.5),
    "mesh 2": Scene(  # both wheels slow down together, until wheel 2 falls behind
        alpha=0.0,
        epsilon=0.4,
        beta1=0.5,
        beta2=0.1,
        gamma1=0.0,
        gamma2=1.0,
        mu=0.6,
        gap1=50.0,
        start=Start(0.0, 0.0, -5.0, 0.4, 0.1),
    ),
    "both meshes": Scene(
        alpha=1.5, epsilon=0.2, beta1=0.01, beta2=0.5, gamma1=0.02, gamma2=0.4, mu=0.6
    ),
}
"""By the mesh that sticks."""

ORDERS = (Order(1, 1.0, 0.2), Order(2, 0.4, 0.3), Order(5, 0.1, -1.0))
THREE = Scene.from_gears(DAT21, sigma=0.1, drive=ORDERS)


def tree(parents, seed=1, alpha=2.0, gamma=0.3, epsilon=(0.6, 0.95), **settings):
    """A gearbox of unequal wheels, started in flight; drags up to `gamma`."""
    rng = np.random.default_rng(seed)
    wheels = [
        Wheel(
            beta=10.0 ** rng.uniform(-1.5, -0.3),
            gamma=gamma * rng.uniform(0.1, 1.0),
            gap=rng.uniform(0.2, 0.8),
            mass=rng.uniform(0.3, 2.0) if i else 1.0,
            parent=parent,
            ratio=rng.uniform(0.6, 1.5),
            epsilon=rng.uniform(*epsilon),
        )
        for i, parent in enumerate(parents)
    ]
    state = [value for wheel in wheels for value in (0.3 * wheel.gap, rng.uniform(-1.0, 1.0))]
    start = Start(rng.uniform(0.0, 6.0), state=state)
    return Scene(alpha=alpha, wheels=wheels, start=start, **settings)


PARENTS = {
    "chain of 3": (0, 1, 2),
    "chain of 5": (0, 1, 2, 3, 4),
    "tree of 4": (0, 0, 1, 1),
    "tree of 7": (0, 1, 1, 0, 4, 2, 4),
}
TREES = {name: tree(parents, sigma=0.1) for name, parents in PARENTS.items()}
"""Chains and trees of wheels."""
