"""Figures that are made but not drawn, and schemes of few paths beside a simulation: both take most
of a report's time."""

from matplotlib.figure import Figure

EMPTY = b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1 1"></svg>\n'


def leave_undrawn(patch):
    """Files of figures are empty from now on, while a patch of pytest lasts."""

    def savefig(figure, file, **settings):
        file.write(EMPTY)

    patch.setattr(Figure, "savefig", savefig)


def show_few_beside(patch):
    """Schemes that are shown beside a simulation have 1,024 paths from now on."""
    patch.setattr("rattle.compare.validation.validate.BESIDE_PATHS", 1024)
