"""Published results as executable self-tests: the installed program is compared with known
properties of such systems.

Every result has negative controls: the same checks with a deliberate error, which must be rejected.
"""

from rattle.compare.checks.check import CHECK_TEXTS, Subject
from rattle.compare.checks.published import impacts, noise

RESULTS: dict[str, Subject] = {
    name.replace("_", "-"): (vars(impacts) | vars(noise))[name] for name in CHECK_TEXTS
}
"""Every result by its name on the command line."""
