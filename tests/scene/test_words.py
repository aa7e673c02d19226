"""What a scene calls its parts: wheels of gears, bodies of any other system."""

from dataclasses import replace

import pytest
from scenes import dat21

from rattle import Scene, Start, Wheel
from rattle.compare.validation.transient import describe_transient
from rattle.scene.long_orbit import REST_FOR_GOOD, attractor

BALL = Scene(
    alpha=0.0,
    epsilon=0.8,
    wheels=[Wheel(gamma=1.0, gap=0.0, one_sided=True, name="wheel")],
    start=Start(x1=0.0, y1=-3.0),
)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("Wheel 1 meshes with wheel 2.", "Body 1 strikes body 2."),
        ("at mesh 1: closed teeth\nstay closed", "at contact 1: a closed contact stays closed"),
        ("mesh", "mesh"),
        ("body 1 (wheel) of `mesh 1`", "body 1 (wheel) of `mesh 1`"),
        ("a higher body.wheel.gap, rate_mesh1", "a higher body.wheel.gap, rate_mesh1"),
        ("mesh of 'wheel' or mesh=1", "contact of 'wheel' or mesh=1"),
    ],
)
def test_a_text_about_gears_is_put_into_words_of_bodies(text, expected):
    assert BALL.words.put_into(text) == expected
    assert dat21().words.put_into(text) == text


def test_a_scene_knows_what_its_parts_are_called():
    pair = Scene(alpha=1.0, epsilon=0.6, bodies=True, wheels=[Wheel(name="ball")])
    gears = replace(pair, bodies=False)
    assert (BALL.words.mesh, pair.words.mesh, gears.words.mesh) == ("contact", "contact", "mesh")
    for scene in (BALL, pair, gears):
        kept = Scene.from_toml(scene.to_toml())
        assert (kept, kept.words) == (scene, scene.words)


def test_an_answer_speaks_of_bodies():
    said = describe_transient(replace(BALL, sigma=0.5, noise=1))
    assert "has no impacts in the long run: body.wheel.gamma is 1, above the threshold of 0" in said


def test_a_motion_that_decays_comes_to_rest():
    mass = Wheel(beta=0.2, gap=0.0, stiffness=1.0, one_sided=True)
    driven = replace(BALL, wheels=[mass], alpha=0.5)
    assert attractor(replace(driven, alpha=0.0)).kind == REST_FOR_GOOD
    assert attractor(driven).kind != REST_FOR_GOOD
