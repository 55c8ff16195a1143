"""Every threshold of a refinement: what it means and where it comes from."""

from __future__ import annotations

HELPS = 0.9995
"""Held-out error over what it was before, up to which an effect is kept where later data cannot tell."""
SAME = 1.002
"""Ratio of errors on later data within which two models are considered equal there: a step in the last block of
a record helps nothing that comes later."""
MOSTLY = 2.0
"""Blocks, held out or later, whose error falls, over those in which it rises, from which an effect that is not of time
alone is kept. What the two errors together favour and this count refuses (products, most of all) raised the error of
the readings afterwards by 1.75 dB on the average of seven effects; see `benchmarks/refine_rules.py`."""
TRIES = 4
"""Causes that are tried in a step, the one worth most on data not learned from first; each costs eleven fits."""
WIDELY = (1.0, 0.5, 0.25, 0.1, 0.03, 0.01)
"""Steps of the search around the parameters of an effect that was just added, chosen beside other lags."""
MOVES = 8
"""Most moves of one length, of each effect."""
FURTHER_HELP = 0.99
"""Errors over those before, up to which an effect gets a further lag, or a proven one is kept that few blocks show."""
FURTHER_LAGS = 3
"""Lags that an effect may get beside the first, each only where data that it was not learned from are better for it."""
OTHER_TIMES = (0.25, 0.4, 0.63, 1.6, 2.5, 4.0)
"""Factors on the time constant of an effect that was just added, at which its errors are compared: coarse, for the
errors of a few blocks are."""
CLEARLY_LESS = 0.9
"""Errors over those before, up to which something else takes the place of what a diagnosis names, such as another time
constant than the one that explains most. Of the room beside a resistor it is 0.67, and 0.24 ppm on the rest instead of
0.37; with 0.99, soil had 0.65 K, not 0.61."""
NEXT_LAG = 2.5
"""Ratio of neighbouring time constants that are tried as further lags of an effect: closer ones say nearly the same."""
LOWER = 1 - 1e-4
"""Residual over the least so far below which moved parameters are kept."""
JOINTLY = (0.1, 0.03)
"""Steps of the joint search around the parameters of the effects at the end."""
