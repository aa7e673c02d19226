"""Monte Carlo of the rattling system: Euler-Maruyama ensembles of Eqs. 5 and 6 with both impact laws."""

from montecarlo.ensemble import simulate
from montecarlo.reach import AccuracyWarning
from montecarlo.result import Ensemble
from montecarlo.schemes import SCHEMES
from montecarlo.settings import check_settings
from montecarlo.step import default_step, largest_step

__all__ = ["SCHEMES", "AccuracyWarning", "Ensemble", "check_settings", "default_step", "largest_step", "simulate"]
