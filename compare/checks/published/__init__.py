"""Published results as executable self-tests: the installed program is compared with known properties of such systems.

Every result has negative controls: the same checks with a deliberate error, which must be rejected.
"""

from rattle.compare.checks.check import Subject
from rattle.compare.checks.published.basins import gear_rattle_basins
from rattle.compare.checks.published.exits import exit_side, exit_time, random_gap
from rattle.compare.checks.published.gaussian import elastic_box, free_flight
from rattle.compare.checks.published.impacts import bouncing_ball, energy_law, impact_laws
from rattle.compare.checks.published.orbits import exponent_sum, impact_pair, orbit_exponents
from rattle.compare.checks.published.returns import critical_restitution, return_moments, return_speed

RESULTS: dict[str, Subject] = {
    result.__name__.replace("_", "-"): result
    for group in (
        (exit_time, return_speed, return_moments, critical_restitution),
        (bouncing_ball, elastic_box, exponent_sum, orbit_exponents, free_flight),
        (impact_laws, energy_law, impact_pair, random_gap, exit_side),
        (gear_rattle_basins,),
    )
    for result in group
}
"""Every result by its name on the command line."""
