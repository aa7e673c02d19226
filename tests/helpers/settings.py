"""Settings of `simulate` as one flat dictionary, for tests that vary them."""

from dataclasses import fields

from rattle.montecarlo import Record, Sampling

__all__ = ["recorded"]

GATHERED = {"record": Record, "sampling": Sampling}


def recorded(settings):
    """The settings with those of `Record` and of `Sampling` gathered into one each."""
    given = dict(settings)
    for name, kind in GATHERED.items():
        if own := {
            field.name: given.pop(field.name) for field in fields(kind) if field.name in given
        }:
            given[name] = kind(**own)
    return given
