"""Scenes that the tests of the closures share: name to a function of sigma."""

from rattle.scene import DAT21, Scene, Start

PLAIN = {
    "alpha": 1.5,
    "epsilon": 0.9,
    "beta1": 1 / 12,
    "beta2": 2 / 15,
    "gamma1": 0.057,
    "gamma2": 0.029,
    "mu": 0.6,
}
FLIGHT = Start(0.3, 0.1, 1.0, -0.2, -0.7)
SCENES = {
    "DAT21": lambda s: Scene.from_gears(DAT21, sigma=s),
    "unequal gaps": lambda s: Scene(**{**PLAIN, "gap2": 0.3}, sigma=s),
    "equal damping": lambda s: Scene(**{**PLAIN, "beta2": 1 / 12}, sigma=s),
    "single stage": lambda s: Scene.from_gears(DAT21, stages=1, sigma=s),
    "restitution 0.5": lambda s: Scene(**{**PLAIN, "epsilon": 0.5}, sigma=s),
    "flight start": lambda s: Scene(**PLAIN, start=FLIGHT, sigma=s),
}
