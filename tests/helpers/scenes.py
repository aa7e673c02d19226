"""Scenes that several folders of tests share."""

from dataclasses import replace

import numpy as np

from rattle import DAT21, Gears, Order, Scene, Start, Wheel
from rattle.scene import section_names


def dat21(sigma=0.0, **settings):
    """The paper's scene."""
    return Scene.from_gears(DAT21, sigma=sigma, **settings)


PAPER_SIGMA = 1.5**0.5
"""The paper's noise."""
SECTION = list(section_names(2))
"""Quantities of its section."""
BESIDE_ALPHA = {name: value for name, value in DAT21.values.items() if name != "alpha"}
"""Its gears without their drive."""
TURNING = Gears.driven(amplitude=0.3, speed_rpm=800.0, driver_radius=30.0, **BESIDE_ALPHA)
"""The same gears at a mean speed."""

RARE = Scene.from_gears(replace(DAT21, alpha=2.398))
"""At the noise 0.00226 three in a million paths make an sd 3.8 times that of `saltation`."""
IMPACT_PAIR = Scene(alpha=0.25, epsilon=0.5, beta1=0.02, gamma1=0.0, stages=1)
"""A periodic motion with two impacts a period."""
UNGEARED = Scene(alpha=1.5, epsilon=0.9, beta1=0.1, gamma1=0.05, mu=0.5, sigma=0.1)
"""A scene that was not made from gears."""
UNEQUAL = Scene(
    alpha=0.8,
    epsilon=0.7,
    beta1=0.3,
    beta2=0.01,
    gamma1=0.2,
    gamma2=0.5,
    mu=0.3,
    gap1=0.2,
    gap2=1.1,
    sigma=0.2,
    start=Start(1.0, 0.2, 1.0, -0.4, 0.3, mesh=1),
)
"""Gaps and wheels that are not alike."""
OSCILLATOR = Scene(
    alpha=1.2,
    epsilon=0.8,
    noise="mass",
    wheels=[Wheel(beta=0.2, gamma=0.1, gap=0.4, stiffness=2.0, one_sided=True, name="mass")],
    start=Start(0.3, -0.05, 0.5),
)
"""A mass that a spring holds above a table that shakes."""

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
THREE = dat21(0.1, drive=ORDERS)


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


def chain(law, sigma):
    """Two wheels in a row with a law of restitution at both meshes."""
    first = Wheel(beta=0.083, gamma=0.4, restitution=law)
    second = Wheel(beta=0.07, gamma=0.3, parent=1, mass=0.8, restitution=law)
    return Scene(alpha=1.5, sigma=sigma, epsilon=0.9, wheels=[first, second])


PARENTS = {
    "chain of 3": (0, 1, 2),
    "chain of 5": (0, 1, 2, 3, 4),
    "tree of 4": (0, 0, 1, 1),
    "tree of 7": (0, 1, 1, 0, 4, 2, 4),
}
TREES = {name: tree(parents, sigma=0.1) for name, parents in PARENTS.items()}
"""Chains and trees of wheels."""
FOUR = TREES["tree of 4"]
