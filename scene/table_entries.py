"""Entries of tables, by labels of rows and names of columns that are themselves columns."""

from typing import TYPE_CHECKING

import numpy as np

from rattle.scene.types import Floats

if TYPE_CHECKING:
    import pandas as pd


def pick(table: "pd.DataFrame", label: "pd.Series", column: "pd.Series") -> Floats:
    """Entries of a table by label of the row and by column; NaN where it has none."""
    import pandas as pd

    row, labels = pd.factorize(label)
    code, names = pd.factorize(column)
    values = table.reindex(index=labels, columns=names).to_numpy(float)
    return np.asarray(values[row, code])
