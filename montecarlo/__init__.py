"""Monte Carlo of the rattling system: ensembles of Eqs. 5 and 6 with impacts at both meshes.

Two Euler-Maruyama schemes and exact flights (`SCHEMES`) advance the paths.  `simulate` runs a given
number of them, `simulate_to` as many as an accuracy takes; both reduce them to section moments, and
to moments at fixed times and whatever else a `Record` asks for.  `simulate_rare` draws a part of
the paths near rare branches.  Each name is imported on first access.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
