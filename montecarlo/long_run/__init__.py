"""The long run: stationary quantities of an ensemble of independent paths of exact flights, in flat
memory."""

from rattle.montecarlo.long_run.result import BurnIn, LongRun, SectionDensity
from rattle.montecarlo.long_run.run import AtRest, BurnInError, expect_run, long_run

__all__ = ["AtRest", "BurnIn", "BurnInError", "LongRun", "SectionDensity", "expect_run", "long_run"]
