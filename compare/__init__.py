"""What holds closures against simulations; its results and what they share.

Each name is imported on first access: a command that needs none of them begins sooner.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
