r"""
Verdicts without sampling error: a ball under gravity with white noise
======================================================================

.. math:: dv = -g\,dt + \sigma\,dW, \quad x \ge 0, \quad v^+ = -r v^-

is solved: the joint density of the time of a flight and of the speed at its end is known (McKean
1963). In units in which :math:`g = \sigma = 1`, for a start at speed u from the floor,

.. math:: p(T, w | u) = \frac{\sqrt 3 w}{\pi T^2}
          e^{-2 (u^2 - u w + w^2)/T + u + w - T/2} \operatorname{erf} \sqrt{6 u w / T}.

Its moments by quadrature are a reference without error, as a table with standard errors of 0. First
order saltation, written by hand, says: mean T = 2u, mean w = u, sd T = :math:`\sqrt{8u/3}`, sd w =
:math:`\sqrt{2u/3}`. Started fast it is accurate, started slowly its standard deviations are not.
"""

import numpy as np
import pandas as pd
from scipy.special import erf

from rattle import judge


def exact(u, points=1500):
    """Mean and sd of flight time and return speed, by quadrature."""
    times = np.linspace(0.0, 2.0 * u + 40.0 + 12.0 * np.sqrt(u), points + 1)[1:, None]
    speeds = np.linspace(0.0, u + 20.0 + 6.0 * np.sqrt(u), points + 1)[None, 1:]
    exponent = -2.0 * (u**2 - u * speeds + speeds**2) / times + u + speeds - 0.5 * times
    density = np.sqrt(3.0) * speeds / (np.pi * times**2) * np.exp(exponent)
    density *= erf(np.sqrt(6.0 * u * speeds / times))
    density /= density.sum()
    moments = {}
    for name, values in (("T", times), ("w", speeds)):
        mean = float((values * density).sum())
        moments[name] = mean
        moments[f"sd_{name}"] = float(np.sqrt(((values - mean) ** 2 * density).sum()))
    return moments


starts = pd.Index([1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 40.0], name="u")
reference = pd.DataFrame([exact(u) for u in starts], index=starts)
reference = reference.assign(**{f"se_{name}": 0.0 for name in reference})
u = starts.to_numpy()
saltation = pd.DataFrame(
    {"T": 2.0 * u, "w": u, "sd_T": np.sqrt(8.0 * u / 3.0), "sd_w": np.sqrt(2.0 * u / 3.0)}, starts
)
second = saltation.assign(T=2.0 * u + 2.0 / 3.0, w=u + 2.0 / 3.0)  # means to second order

found = judge({"saltation": saltation, "second order": second}, reference)
print(found)
print(found.table.pivot(index=["closure", "u"], columns=["quantity", "moment"], values="verdict"))
figure = found.plot()
