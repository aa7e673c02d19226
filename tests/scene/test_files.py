"""Files that are read by every reader of TOML and JSON: line ends, byte-order marks, other
encodings."""

from pathlib import Path

import pytest
from refusals import refusal

from rattle import Scene, Study
from rattle.compare.cli.terminal import read_page
from rattle.compare.report.manifest import read_settings
from rattle.compare.thresholds.fixture import read_baseline
from rattle.scene import FileError
from rattle.scene.files import MOST_BITS, MOST_DEPTH, MOST_TOML, parse_json, read_toml

READERS = {
    "scene file": Scene.load,
    "study file": Study.load,
    "baseline": read_baseline,
    "manifest": lambda path: read_settings(Path(path)),
    "page": lambda path: read_page(Path(path)),
}


@pytest.mark.parametrize("reader", READERS)
def test_a_file_that_is_no_text_or_not_there_is_refused_by_name(reader, tmp_path):
    (path := tmp_path / "latin.toml").write_bytes("name = 'Übersetzung'".encode("latin-1"))
    for place, why in (
        (path, "is not UTF-8 text; give a"),
        (tmp_path / "none", "cannot be read (No such file"),
    ):
        with pytest.raises(FileError) as refused:
            READERS[reader](place)
        assert str(refused.value).startswith(f"{reader} = {str(place)!r}: {why}")
    with pytest.raises(FileError, match="is no path"):
        Scene.load(5)


def test_line_ends_and_a_byte_order_mark_of_other_systems(tmp_path):
    path = tmp_path / "windows.toml"
    scene = Scene(alpha=1.0, epsilon=0.5, beta1=0.1, gamma1=0.1, stages=1)
    path.write_bytes(b"\xef\xbb\xbf" + scene.to_toml().replace("\n", "\r\n").encode())
    assert Scene.load(path) == scene


DEEP = 100_000
TOO_MUCH = {
    "header": (f"[{'a.' * DEEP}a]", "a key has more than"),
    "dotted key": (f"{'a . ' * DEEP}a = 1", "a key has more than"),
    "quoted key": (f"""{"'a'." * DEEP}a = 1""", "a key has more than"),
    "list": (f"a = {'[' * DEEP}", "nested more than"),
    "list of few levels": (f"a = {'[' * 200}{']' * 200}", "nested more than"),
    "tables": (f"a = {'{a = ' * 200}1{'}' * 200}", "nested more than"),
    "digits": (f"alpha = {'9' * 5000}", "an integer is larger"),
    "fewer digits": (f"alpha = {'9' * 400}", "an integer is larger"),
    "hexadecimal": (f"alpha = 0x{'f' * 5000}", "an integer is larger"),
    "size": ("a = 1\n" * MOST_TOML, "characters, more than"),
}


@pytest.mark.parametrize("kind", TOO_MUCH)
@pytest.mark.parametrize("reader", ["scene file", "study file", "baseline"])
def test_toml_that_is_too_much_is_refused_in_one_line(kind, reader, tmp_path):
    text, why = TOO_MUCH[kind]
    (path := tmp_path / "much.toml").write_text(text)
    with pytest.raises(FileError, match=why) as refused:
        READERS[reader](path)
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 600


def test_what_is_within_the_limits_is_read():
    """A thousand numbers on one line have more dots than a key may have parts."""
    text = f"a = {[[0.5] * 1000]}\n{'b.' * (MOST_DEPTH - 1)}c = 1\nd = {2**MOST_BITS - 1}"
    assert read_toml(text)["a"] == [[0.5] * 1000]
    with refusal("give text"):
        read_toml(b"a = 1")


JSON = {
    "lists": "[" * DEEP,
    "closed lists": f"{'[' * 200}{']' * 200}",
    "objects": '{"a":' * DEEP,
    "digits": "9" * 5000,
    "fewer digits": f"[{'9' * 400}]",
}


@pytest.mark.parametrize("kind", JSON)
def test_json_that_is_too_much_is_refused_in_one_line(kind, tmp_path):
    (path := tmp_path / "much.json").write_text(JSON[kind])
    with pytest.raises(ValueError, match=r"nested|integer|Expecting"):
        parse_json(JSON[kind])
    with pytest.raises(FileError, match="is no manifest") as refused:
        read_settings(path)
    assert "\n" not in str(refused.value)


def test_the_line_of_a_wrong_key_is_found_soon_in_any_header(tmp_path):
    """Many spaces within a header are no work of their square."""
    (path := tmp_path / "wide.toml").write_text(f'["scene{" " * 300_000}x"]\na = 1\n')
    with refusal("unknown key"):
        Scene.load(path)
