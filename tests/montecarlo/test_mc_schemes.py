"""Orders without walls and on the noise-free orbit; and mesh 1 comes first where both are struck at
once."""

from dataclasses import replace

import pytest

from rattle.closure import follow
from rattle.montecarlo import Record, simulate
from rattle.scene import Scene, Start


def both_walls_at(time, gap1=0.5, gap2=1.7):
    """No force, and both displacements meet their walls at one instant; there mesh 2 reverses mesh
    1 again."""
    start = Start(0.0, 0.0, gap1 / time, 0.1, -(gap2 + 0.1) / time)
    return Scene(
        alpha=0.0, epsilon=0.5, beta1=0.0, gamma1=0.0, mu=0.3, gap1=gap1, gap2=gap2, start=start
    )


@pytest.mark.parametrize("side", ["orbit", "exact-flight", "euler-maruyama-located"])
def test_mesh_1_comes_first_where_both_are_struck_at_one_instant(side):
    def struck_together(scene, impacts):
        orbit = follow(scene, impacts)
        mesh = orbit.mesh[1:]
        tau = orbit.tau[1:]
        if side != "orbit":
            columns = simulate(
                scene, paths=1, impacts=impacts, scheme=side, record=Record(step_bias=False)
            ).columns
            mesh = columns["mesh"]
            tau = columns["tau"]
        return list(zip(mesh.tolist(), tau.round(9).tolist(), strict=True))

    for time in (0.1, 0.5, 1.0, 2.0, 3.0, 7.0):
        assert struck_together(both_walls_at(time), 4) == [(1, time), (2, time)] * 2
    again = Scene(alpha=0.0, epsilon=0.5, beta1=0.0, gamma1=0.0, mu=0.5, gap2=3.0)
    assert struck_together(again, 4) == [(1, 1.0), (1, 3.0), (1, 7.0), (1, 15.0)]
    later = replace(both_walls_at(2.0), gap1=0.5 + 1e-9)
    assert struck_together(later, 1) == [(2, 2.0)]
