"""The pytest plugin: options, marker, fixture, summary.  Nothing heavy is imported before a marked test is collected.

PYTEST_DONT_REWRITE
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import pytest

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rattle.compare.thresholds.claim import Claim
    from rattle.compare.thresholds.decision import Thresholds
    from rattle.compare.thresholds.fixture import Rattle

THRESHOLDS: pytest.StashKey[Thresholds] = pytest.StashKey()
CLAIM: pytest.StashKey[Claim] = pytest.StashKey()
REFUSED: pytest.StashKey[Exception] = pytest.StashKey()

MARKER = (
    "rattle(scene, impacts=4, kind='section', quantities=('tau', 'y1', 'y2'), moments=('mean', 'sd'), within={'mean': "
    "0.05, 'sd': 0.1}, absolute=None, paths=None, budget=None, accuracy=None, scheme='exact-flight', undecided=None): "
    "section moments of a closure, of all paths or (kind='itinerary') of those on its itinerary alone, and their "
    "admissible error, in sds of the quantity (within) or absolute."
)


class Option(NamedTuple):
    """An option of the command line; if `lasting`, also of the configuration file."""

    name: str
    default: str
    help: str
    choices: tuple[str, ...] | None = None
    lasting: bool = True

    @property
    def key(self) -> str:
        """Its name in the configuration file."""
        return self.name.replace("-", "_")


OPTIONS = (
    Option("rattle-false-alarm", "0.01", "Probability that a test fails although its claim is true."),
    Option("rattle-undecided", "fail", "Outcome of a test that its budget does not decide.", ("fail", "skip")),
    Option("rattle-profile", "quick", "Simulated paths to begin with: quick 32768, full 1048576.", ("quick", "full")),
    Option("rattle-budget", "", "Most paths for a test that is undecided. [default: 8 times those it begins with]"),
    Option("rattle-cache", "", "Folder of the simulations. [default: in pytest's cache; without it none is kept]"),
    Option("rattle-seed", "0", "Seed of the simulations."),
    Option("rattle-workers", "1", "Threads of a simulation; the result does not depend on it."),
    Option(
        "rattle-baselines",
        "compare",
        "Compare with recorded values, record those that are missing, or regenerate.",
        ("compare", "record", "regenerate"),
        lasting=False,
    ),
)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Options on the command line and in the configuration file, where the command line wins."""
    group = parser.getgroup("rattle", "accuracy thresholds")
    for option in OPTIONS:
        text = f"{option.help} [default: {option.default}]" if option.default else option.help
        group.addoption(f"--{option.name}", dest=option.key, default=None, choices=option.choices, help=text)
        if option.lasting:
            parser.addini(option.key, option.help, default=option.default)


def read_options(config: pytest.Config) -> dict[str, str]:
    """The user's choice of every option as text, by key."""
    given = {option: config.getoption(option.key) for option in OPTIONS}
    kept = {option: config.getini(option.key) if option.lasting else option.default for option in OPTIONS}
    return {option.key: str(kept[option] if given[option] is None else given[option]) for option in OPTIONS}


def pytest_configure(config: pytest.Config) -> None:
    """Register the marker, and refuse an invalid option before anything is collected."""
    config.addinivalue_line("markers", MARKER)
    if read_options(config) != {option.key: option.default for option in OPTIONS}:
        from rattle.compare.thresholds.claim import read_settings
        from rattle.scene.errors import InputError

        try:
            read_settings(read_options(config))
        except InputError as error:
            raise pytest.UsageError(str(error)) from None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_finish(session: pytest.Session) -> None:
    """Store the claim of each selected test, or the error of its marker, in the stash of the test.

    A test that inherits the marker but does not use the fixture has no claim.
    """
    marked = [item for item in session.items if item.get_closest_marker("rattle")]
    if not marked:
        return
    from rattle.compare.thresholds.claim import read_markers, read_settings
    from rattle.compare.thresholds.decision import Thresholds
    from rattle.scene.errors import RattleError

    session.config.stash[THRESHOLDS] = Thresholds(read_settings(read_options(session.config)), session.config)
    for item in marked:
        if "rattle" in getattr(item, "fixturenames", ()):
            try:
                item.stash[CLAIM] = read_markers(item.iter_markers("rattle"), item.path.parent)
            except Exception as error:  # any error in reading a marker belongs to this test alone
                item.stash[REFUSED] = error
        elif any(mark.name == "rattle" for mark in item.own_markers):
            item.stash[REFUSED] = RattleError("its marker has no effect; let the test take the fixture 'rattle'")


def pytest_report_collectionfinish(config: pytest.Config, items: Sequence[pytest.Item]) -> list[str]:
    """Report invalid markers with --collect-only, when no test runs that would report them."""
    refused = [item for item in items if REFUSED in item.stash] if config.option.collectonly else []
    return [f"rattle: {item.nodeid}: {item.stash[REFUSED]}" for item in refused]


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Fail a test whose own marker is not valid."""
    if REFUSED in item.stash:
        from rattle.scene.errors import RattleError

        if isinstance(error := item.stash[REFUSED], RattleError):
            pytest.fail(f"rattle: {error}", pytrace=False)
        raise error


@pytest.fixture
def rattle(request: pytest.FixtureRequest) -> Rattle:
    """Fixture that compares a closure with the simulation of the marker's scene: ``rattle.check(model)``."""
    from rattle.compare.thresholds.fixture import Rattle

    if CLAIM not in request.node.stash:
        pytest.fail(
            "rattle: the test has no marker; give it one, as in @pytest.mark.rattle(scene='dat21.toml', within=0.05)",
            pytrace=False,
        )
    return Rattle(request.node, request.node.stash[CLAIM], request.config.stash[THRESHOLDS])


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Print what was checked and what it cost; nothing if no test used the fixture."""
    reports = [r for listed in terminalreporter.stats.values() for r in listed if getattr(r, "when", None) == "call"]
    found = [(r.nodeid, value) for r in reports for key, value in r.user_properties if key == "rattle"]
    records = {(test, facts["kind"]): (test, facts) for test, facts in found}  # reports of subtests repeat them
    if records:
        from rattle.compare.thresholds.messages import summary_lines
        from rattle.scene.text import harmless

        terminalreporter.section("rattle: accuracy thresholds")
        for line in summary_lines(list(records.values())):
            terminalreporter.write_line(harmless(line, keep=""))
