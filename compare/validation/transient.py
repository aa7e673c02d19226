"""Whether the first impacts of a scene are a transient, by the threshold of rattle and the end of
the orbit."""

from rattle.compare.report.render import render_sentences
from rattle.scene import Scene
from rattle.scene.changes import spell
from rattle.scene.long_orbit import REST_FOR_GOOD, attractor
from rattle.scene.threshold import rattle_threshold

ALWAYS = 0.9995  # share of the time from which on a mesh is called closed throughout


def describe_transient(scene: Scene) -> str:
    """That gears come to rest, or that a mesh does not open by itself; empty where all teeth
    open."""
    wheels = rattle_threshold(scene)
    closed = [wheel for wheel in wheels if not wheel.opens]
    if not closed:
        return ""
    end = attractor(scene)
    rests = end.kind == REST_FOR_GOOD
    # above the threshold a motion that is not at rest may go on
    if not rests and len(closed) == len(wheels):
        return ""
    shares = [share for wheel in closed if (share := end.contact[wheel.wheel - 1]) > 0.0]
    (sentence,) = render_sentences(
        "validation/transient.j2",
        scene.words,
        closed=closed,
        # nothing else can hold what is alone
        dragged=[wheel for wheel in closed if wheel.least > 0.0 or len(wheels) == 1],
        rests=rests,
        noisy=scene.sigma > 0.0,
        gears=scene.gears,
        share=shares[0] if len(closed) == 1 and shares else None,
        stages=scene.stages,
        scene=scene,
        drag_name=lambda wheel: spell(scene, f"gamma{wheel}"),
        always=ALWAYS,
    )
    return sentence
