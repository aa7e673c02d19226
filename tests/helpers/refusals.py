"""What is refused, by the words in which it is."""

import re

import pytest

from rattle import InputError


def refusal(pattern=None, field=None):
    """The context in which input is refused with a text that has this pattern, and by its field."""
    return pytest.raises(
        InputError, match=pattern, check=lambda error: field in (None, error.field)
    )


def refusal_in_words(*words, field=None):
    """The same with words as they stand, in their order; anything may stand between them, and for a
    ``…`` in them."""
    return refusal("(?s)" + ".*".join(map(re.escape, "…".join(words).split("…"))), field)
