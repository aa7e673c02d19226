"""What a validation says of a drive of several orders and of noise with a memory."""

from rattle import DAT21, Order, Scene, validate
from rattle.montecarlo.diagnostics.diagnostics import UNSEARCHED

SETTINGS = {"impacts": 2, "closures": ["saltation"], "paths": 2000}


def test_the_page_shows_the_drive_and_says_that_no_rare_branch_was_looked_for(tmp_path):
    plain = Scene.from_gears(DAT21, sigma=0.02)
    other = Scene.from_gears(DAT21, sigma=0.02, drive=[Order(1), Order(3, 0.2)], correlation_time=1.0)
    pages = [
        validate(scene, **SETTINGS).report(tmp_path / name) for name, scene in (("plain", plain), ("other", other))
    ]
    assert [(page.parent / "figures" / "drive.svg").exists() for page in pages] == [False, True]
    assert [UNSEARCHED in page.read_text() for page in pages] == [False, True]
    assert ["are counted where they could change a verdict" in page.read_text() for page in pages] == [True, False]
