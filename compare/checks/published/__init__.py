"""Published results as executable self-tests: the installed program is compared with known properties of such systems.

Every result has negative controls: the same checks with a deliberate error, which must be rejected.
"""

from rattle.compare.checks.check import PUBLISHED, collect
from rattle.compare.checks.published import impacts, noise

RESULTS = {name.replace("_", "-"): result for name, result in collect(PUBLISHED, impacts, noise).items()}
"""Every result by its name on the command line."""
