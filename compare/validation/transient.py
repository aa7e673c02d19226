"""Whether the first impacts of a scene are a transient, by the threshold of rattle and the end of
the orbit."""

from rattle.compare.judge.verdict import join_words
from rattle.scene import Scene
from rattle.scene.long_orbit import REST_FOR_GOOD, attractor
from rattle.scene.text import number_text, percent
from rattle.scene.threshold import RattleThreshold, rattle_threshold

ALWAYS = 0.9995  # share of the time from which on a mesh is called closed throughout


def describe_transient(scene: Scene) -> str:
    """That gears come to rest, or that a mesh does not open by itself; empty where all teeth
    open."""
    wheels = rattle_threshold(scene)
    closed = [wheel for wheel in wheels if not wheel.opens]
    if not closed:
        return ""
    end = attractor(scene)
    drags = ", and ".join(_compare(wheel, scene) for wheel in closed if wheel.least > 0.0)
    drags += "".join(
        f", which holds wheel {wheel.wheel} too" for wheel in closed if wheel.least == 0.0
    )
    if end.kind == REST_FOR_GOOD:
        noisy = scene.sigma > 0.0
        name = "These gears do" if scene.gears else "This motion does"
        name = f"Without noise {name[0].lower()}{name[1:]}" if noisy else name
        remains = (
            "; `rattle stationary` says what the noise leaves in the long run" if noisy else ""
        )
        return (
            f"{name} not rattle in the long run: {drags}. The first impacts are the transient from"
            f" the start{remains}."
        )
    if len(closed) == len(wheels):  # above the threshold a motion that is not at rest may go on
        return ""
    meshes = join_words([f"mesh {wheel.wheel}" for wheel in closed])
    shares = [share for wheel in closed if (share := end.contact[wheel.wheel - 1]) > 0.0]
    part = f"; without noise it is closed {_share(shares[0])} in the long run" if shares else ""
    return (
        f"{meshes[0].upper()}{meshes[1:]} does not open by itself in the long run: {drags}. It is"
        f" struck only because the other mesh rattles{part}."
    )


def _compare(wheel: RattleThreshold, scene: Scene) -> str:
    name = f"the drag torque on wheel {wheel.wheel}" if scene.gears else f"gamma{wheel.wheel}"
    own, least = (drag_text(value, wheel.unit) for value in (wheel.drag, wheel.least))
    return f"{name} is {own}, above the threshold of {least}"


def drag_text(value: float, unit: str) -> str:
    """A drag to four digits, without an exponent where it is not needed."""
    return f"{number_text(value, 4)} {unit}".rstrip()


def _share(share: float) -> str:
    return "all of the time" if share > ALWAYS else f"{percent(share)} of the time"
