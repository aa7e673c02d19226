"""The pytest plugin: options, marker, fixture, summary.  Nothing heavy is imported before a marked
test is collected.

PYTEST_DONT_REWRITE
"""

from __future__ import annotations

import tomllib
from importlib.resources import files
from itertools import chain
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rattle.compare.thresholds.claim import Claim
    from rattle.compare.thresholds.decision import Thresholds
    from rattle.compare.thresholds.fixture import Rattle
    from rattle.compare.thresholds.judged import Judge

THRESHOLDS: pytest.StashKey[Thresholds] = pytest.StashKey()
CLAIM: pytest.StashKey[Claim] = pytest.StashKey()
REFUSED_KEY: pytest.StashKey[Exception] = pytest.StashKey()

PLUGIN_TEXTS = tomllib.loads(
    files("rattle.compare.thresholds").joinpath("texts.toml").read_text(encoding="utf-8")
)
PLUGIN_OPTIONS: dict[str, dict[str, Any]] = PLUGIN_TEXTS["options"]


def pytest_addoption(parser: pytest.Parser) -> None:
    """Options on the command line and in the configuration file, where the command line wins."""
    group = parser.getgroup("rattle", "accuracy thresholds")
    for key, option in PLUGIN_OPTIONS.items():
        name = key.replace("_", "-")
        default = option["default"]
        text = f"{option['help']} [default: {default}]" if default else option["help"]
        group.addoption(
            f"--{name}", dest=key, default=None, choices=option.get("choices"), help=text
        )
        if option.get("lasts", True):
            parser.addini(key, option["help"], default=default)


def read_options(config: pytest.Config) -> dict[str, str]:
    """The user's choice of every option as text, by key."""
    chosen = {}
    for key, option in PLUGIN_OPTIONS.items():
        kept = config.getini(key) if option.get("lasts", True) else option["default"]
        given = config.getoption(key)
        chosen[key] = str(kept if given is None else given) or option["default"]
    return chosen


def pytest_configure(config: pytest.Config) -> None:
    """Register the marker, and refuse an invalid option before anything is collected."""
    config.addinivalue_line("markers", PLUGIN_TEXTS["marker"])
    if read_options(config) != {key: option["default"] for key, option in PLUGIN_OPTIONS.items()}:
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
    if all("judge" in getattr(item, "fixturenames", ()) for item in marked):
        return
    from rattle.compare.thresholds.claim import read_markers, read_settings
    from rattle.compare.thresholds.decision import Thresholds
    from rattle.scene.errors import RattleError

    session.config.stash[THRESHOLDS] = Thresholds(
        read_settings(read_options(session.config)), session.config
    )
    for item in marked:
        fixtures = getattr(item, "fixturenames", ())
        if "rattle" in fixtures:
            try:
                item.stash[CLAIM] = read_markers(item.iter_markers("rattle"), item.path.parent)
            except Exception as error:  # any error in reading a marker belongs to this test alone
                item.stash[REFUSED_KEY] = error
        elif "judge" not in fixtures and any(m.name == "rattle" for m in item.own_markers):
            item.stash[REFUSED_KEY] = RattleError(
                "its marker has no effect; let the test take the fixture 'rattle' or 'judge'"
            )


def pytest_report_collectionfinish(
    config: pytest.Config, items: Sequence[pytest.Item]
) -> list[str]:
    """Report invalid markers with --collect-only, when no test runs that would report them."""
    if not config.option.collectonly:
        return []
    refused = [item for item in items if REFUSED_KEY in item.stash]
    return [f"rattle: {item.nodeid}: {item.stash[REFUSED_KEY]}" for item in refused]


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Fail a test whose own marker is not valid."""
    if REFUSED_KEY in item.stash:
        from rattle.scene.errors import RattleError

        if isinstance(error := item.stash[REFUSED_KEY], RattleError):
            pytest.fail(f"rattle: {error}", pytrace=False)
        raise error


@pytest.fixture
def rattle(request: pytest.FixtureRequest) -> Rattle:
    """Fixture that compares a closure with the simulation of the marker's scene:
    ``rattle.check(model)``."""
    from rattle.compare.thresholds.fixture import Rattle

    if CLAIM not in request.node.stash:
        pytest.fail(
            "rattle: the test has no marker; give it one, as in"
            " @pytest.mark.rattle(scene='dat21.toml', within=0.05)",
            pytrace=False,
        )
    return Rattle(request.node, request.node.stash[CLAIM], request.config.stash[THRESHOLDS])


@pytest.fixture
def judge(request: pytest.FixtureRequest) -> Judge:
    """Fixture that judges predictions by samples of one's own: ``judge(predicted, samples)``."""
    from rattle.compare.thresholds.judged import Judge

    options = read_options(request.config)
    return Judge(request.node, float(options["rattle_false_alarm"]), options["rattle_undecided"])


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Print what was checked and what it cost; nothing if no test used a fixture."""
    records: dict[Any, Any] = {}  # reports of subtests repeat them
    for report in chain.from_iterable(terminalreporter.stats.values()):
        if getattr(report, "when", None) == "call":
            facts = [value for key, value in report.user_properties if key == "rattle"]
            records |= {(report.nodeid, str(fact)): fact for fact in facts}
    if records:
        from rattle.compare.judge.rows import BY_SIZE
        from rattle.compare.report.render import render_text
        from rattle.scene.text import harmless

        facts = [{"test": test, **fact} for (test, _), fact in records.items()]
        text = render_text("thresholds/summary.j2", records=facts, why_size=BY_SIZE)
        terminalreporter.section("rattle: accuracy thresholds")
        for line in text.rstrip("\n").split("\n"):
            terminalreporter.write_line(harmless(line, keep=""))
