"""The command line as a user types it, and a study that is soon computed."""

from click.testing import CliRunner

from rattle.compare.cli.main import main

__all__ = ["rattle", "study"]

STUDY = """
[study]
title = "{title}"
impacts = {impacts}
closures = ["corrected"]
paths = {paths}
[scene]
alpha = 1.5
epsilon = 0.9
beta1 = 0.083
gamma1 = 0.057
stages = 1
[[axes]]
sigma = {sigma}
"""


def study(title="small", impacts=1, paths=64, sigma=(0.1,)):
    """The text of a study file: one stage, one closure that costs nothing, some noise intensities."""
    return STUDY.format(title=title, impacts=impacts, paths=paths, sigma=list(sigma))


def rattle(*words, code=0):
    """Run a command, which ends with this exit code and no traceback."""
    found = CliRunner().invoke(main, [str(word) for word in words])
    assert found.exit_code == code, found.output
    assert "Traceback" not in found.output
    return found
