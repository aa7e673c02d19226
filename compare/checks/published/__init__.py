"""Published results as executable self-tests: the installed program is compared with known
properties of such systems.

Every result has negative controls: the same checks with a deliberate error, which must be rejected.
"""

from rattle.compare.checks.check import Subject
from rattle.compare.checks.published import bodies, impacts, noise
from rattle.compare.report.texts import read_texts

COMPUTED = vars(bodies) | vars(impacts) | vars(noise)
RESULTS = {
    name.replace("_", "-"): Subject(**texts, compute=COMPUTED[name])
    for name, texts in read_texts("checks.published").items()
}
"""Every result by its name on the command line, with what is said of it."""
