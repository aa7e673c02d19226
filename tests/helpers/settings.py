"""Settings of `simulate` as one flat dictionary, for tests that vary them."""

from dataclasses import fields

from rattle.montecarlo import Record

__all__ = ["recorded"]

RECORDED = {field.name for field in fields(Record)}


def recorded(settings):
    """The settings with those of `Record` gathered into one."""
    record = {name: value for name, value in settings.items() if name in RECORDED}
    given = {name: value for name, value in settings.items() if name not in RECORDED}
    return given | ({"record": Record(**record)} if record else {})
