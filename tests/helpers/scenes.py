"""Scenes that several folders of tests share."""

from rattle.scene import DAT21, Order, Scene, Start

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
