"""Files of any size and depth end in one line, soon."""

import os
import threading

import pytest

from rattle.scene.errors import FileError
from rattle.scene.files import MOST_DEPTH, parse_json, read_text, read_toml

DEEP = {
    "lists": "x = " + "[" * 100_000,
    "lists that end": "x = " + "[" * 500 + "]" * 500,
    "tables": "x = " + "{a = " * 500 + "1" + "}" * 500,
    "a header": "[" + ".".join("a" * 100_000) + "]",
    "a quoted header": "[" + ".".join(["'a'"] * 100) + "]",
    "a dotted key": ".".join("a" * 1000) + " = 1",
    "an integer": "x = " + "9" * 6000,
    "a hexadecimal integer": "x = 0x" + "f" * 6000,
    "a large text": "x = [" + "1," * 600_000 + "]",
}


@pytest.mark.parametrize("kind", DEEP)
def test_toml_beyond_any_need_is_refused(kind):
    with pytest.raises(FileError) as caught:
        read_toml(DEEP[kind])
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize("text", ["[" * 100_000, '{"a":' * 100_000, "[" * 200 + "]" * 200, "9" * 6000])
def test_json_beyond_any_need_is_refused(text):
    with pytest.raises(ValueError, match=r"\w"):
        parse_json(text)


def test_what_is_as_deep_as_allowed_is_read():
    """The limit is not so low that it refuses a file that has less."""
    levels = MOST_DEPTH - 2
    assert read_toml("x = " + "[" * levels + "1" + "]" * levels)
    assert parse_json("[" * levels + "]" * levels)


def test_a_pipe_is_read_to_its_end(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    writer = threading.Thread(target=pipe.write_text, args=("alpha = 1.0\n" * 50_000,))
    writer.start()
    assert read_text("scene file", pipe) == "alpha = 1.0\n" * 50_000
    writer.join()


def test_a_device_without_end_is_refused():
    with pytest.raises(FileError, match="more than"):
        read_text("scene file", "/dev/zero")
