"""Files that are read by every reader of TOML and JSON: line ends, byte-order marks, other encodings."""

from pathlib import Path

import pytest

from rattle.compare.report.json_text import read_page
from rattle.compare.report.manifest import read_settings
from rattle.compare.study.design import Study
from rattle.compare.thresholds.fixture import read_baseline
from rattle.scene import FileError, Scene

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
    for place, why in ((path, "is not UTF-8 text; give a"), (tmp_path / "none", "cannot be read (No such file")):
        with pytest.raises(FileError) as refused:
            READERS[reader](place)
        assert str(refused.value).startswith(f"{reader} = {str(place)!r}: {why}")


def test_line_ends_and_a_byte_order_mark_of_other_systems(tmp_path):
    path, scene = tmp_path / "windows.toml", Scene(alpha=1.0, epsilon=0.5, beta1=0.1, gamma1=0.1, stages=1)
    path.write_bytes(b"\xef\xbb\xbf" + scene.to_toml().replace("\n", "\r\n").encode())
    assert Scene.load(path) == scene
