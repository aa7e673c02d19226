r"""
The orbit between its walls
===========================

Without noise the motion is one orbit: both relative displacements :math:`x_1` (driver and wheel 1)
and :math:`x_2` (wheels 1 and 2) between their flanks at :math:`\pm g`. A mark is an impact at that
mesh; an impact at one mesh bends the other curve as well, for wheel 1 has a part in both.
"""

from rattle import DAT21, Scene, follow

figure = follow(Scene.from_gears(DAT21), impacts=24).plot()
