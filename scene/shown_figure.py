"""A figure that a notebook shows."""

from io import BytesIO

from matplotlib.figure import Figure


class ShownFigure(Figure):
    """A figure of matplotlib that a notebook shows, once, as the value of a cell."""

    def _repr_png_(self) -> bytes:
        """The picture that a notebook asks for."""
        picture = BytesIO()
        self.savefig(picture, format="png")
        return picture.getvalue()
