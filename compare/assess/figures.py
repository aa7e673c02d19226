"""The figure of an assessment that is its own: drags and their thresholds."""

from matplotlib.figure import Figure

from rattle.compare.report.style import legend_above, new_figure
from rattle.compare.report.texts import wheel_label
from rattle.scene import Scene
from rattle.scene.threshold import RattleThreshold


def threshold_figure(scene: Scene, thresholds: tuple[RattleThreshold, ...]) -> Figure:
    """Draw the drag of each wheel beside that from which on its closed teeth stay closed."""
    figure, (ax,) = new_figure(7.4, 1.0 + 0.55 * len(thresholds))
    places = range(len(thresholds))
    colours = ["#D55E00" if t.opens else "#009E73" for t in thresholds]
    ax.barh(places, [t.drag for t in thresholds], height=0.5, color=colours)
    for place, threshold in zip(places, thresholds, strict=True):
        ends = place - 0.35, place + 0.35
        line = ax.vlines(threshold.least, *ends, color="0.2", lw=2.0)
    line.set_label("threshold: closed teeth stay closed right of it")
    labels = [f"{scene.words.wheel} {wheel_label(scene, t.wheel)}" for t in thresholds]
    ax.set_yticks(places, labels)
    ax.invert_yaxis()
    unit = thresholds[0].unit
    ax.set(xlabel=f"drag torque ({unit})" if unit else "drag γ", xlim=(0.0, None))
    legend_above(figure, 1)
    return figure
