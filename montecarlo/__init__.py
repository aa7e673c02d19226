"""Monte Carlo of the rattling system: Euler-Maruyama ensembles of Eqs. 5 and 6 with both impact laws."""

from rattle.montecarlo.ensemble import simulate
from rattle.montecarlo.reach import AccuracyWarning
from rattle.montecarlo.result import Ensemble
from rattle.montecarlo.schemes.step_size import default_step, largest_step
from rattle.montecarlo.schemes.table import SCHEMES
from rattle.montecarlo.settings import check_settings

__all__ = ["SCHEMES", "AccuracyWarning", "Ensemble", "check_settings", "default_step", "largest_step", "simulate"]
