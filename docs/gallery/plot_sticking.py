r"""
Chatter, sticking, release
==========================

A single stage with little restitution: impacts accumulate (chatter), the mesh stays closed while
its contact force pushes (shaded), and opens when it would have to pull. The orbit goes through all
of it.
"""

from rattle import Scene, follow

figure = follow(Scene(alpha=1.0, epsilon=0.3, beta1=0.0, gamma1=0.8, stages=1), impacts=40).plot()
