"""Monte Carlo of the rattling system: ensembles of Eqs. 5 and 6 with impacts at both meshes.

Two Euler-Maruyama schemes and exact flights (`SCHEMES`) advance the paths.  `simulate` runs a given
number of them, `simulate_to` as many as an accuracy takes; both reduce them to section moments, and
to moments at fixed times and whatever else a `Record` asks for.  `simulate_rare` draws a part of
the paths near rare branches.
"""

from rattle.montecarlo.accuracy.simulate_to import simulate_to as simulate_to
from rattle.montecarlo.diagnostics.reach import AccuracyWarning as AccuracyWarning
from rattle.montecarlo.diagnostics.reach import Reach as Reach
from rattle.montecarlo.ensemble.result import Ensemble as Ensemble
from rattle.montecarlo.ensemble.simulate import simulate as simulate
from rattle.montecarlo.ensemble.simulate_rare import simulate_rare as simulate_rare
from rattle.montecarlo.schemes.step_size import SCHEMES as SCHEMES
from rattle.montecarlo.schemes.step_size import default_step as default_step
from rattle.montecarlo.schemes.step_size import largest_step as largest_step
from rattle.montecarlo.settings import Record as Record
from rattle.montecarlo.settings import Sampling as Sampling
from rattle.montecarlo.settings import check_settings as check_settings
