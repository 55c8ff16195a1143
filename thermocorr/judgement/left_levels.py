"""Every threshold of what is left and of where a model fails: what it means and where it comes from."""

from __future__ import annotations

# What is left

PROVABLE = 12.0
"""Log likelihood that a drift or step gains on the average where it is proven half of the time: the level, for a family
of seven hundred tests (chi-square, one degree of freedom)."""
DRIFT_TO_STEP, DRIFT_TO_NOISE = 7.0, 3.0
"""The smallest drift that could be told, over the smallest step and over a reading's noise, from which drifts hide in
what the model has. In ordinary records the smallest drift is two to four steps, in few steps of a chamber up to 26."""
TO_A_DECADE = 8
"""Points that a spectrum has to a factor of ten in frequency."""
RANKED = 10
"""Suspects that are listed at most, causes among them."""
FILTER_LENGTH, FILTER_SHARE, FILTER_WHITE, HARDLY_A_FILTER, FILTER_TAILS = 15.0, 0.6, 0.1, 2.0, (2.4, 4.5)
"""Memory of a filter's noise at most [samples]; its share of what wanders; white noise beside it, of all, at most,
unless it remembers for so few samples; fourth moments between which what is left, and its steps, are Gaussian."""
BELOW_FILTER, FEWEST_BELOW, FLAT = 3.0, 15, 4.0
"""Memories of a filter in the period, over two pi, beyond which its noise is white; rows there at least; log likelihood
of what wanders there, over white noise, from which more is left."""
TAILS, NINE_TENTHS = 3.0, 1.645
"""Rms of the residual over its usual size (nine tenths of Gaussian noise are below 1.645), from which a few readings
make most of it. Student's t with three degrees has 1.2, one reading in thirty of sixty times the size 10."""
WANDERS = 0.1
"""Standard deviation of the wandering noise over that of one sample, below which it is not reported."""

# Where it fails

TIME_BINS, VALUE_BINS, HOUR_BINS = 20, 10, 12
"""Stretches of time, ranges of a condition (deciles), and parts of a day that the residual is looked at in."""
DAYS = 4.0
"""Length of a record from which hours of the day are conditions: each has come often enough not to be a date."""
STATES = 4
"""Different values of a column up to which each is a condition of its own: a switch, a mode."""
END_ROWS = 1 << 15
"""Rows at the beginning and at the end of a record that tell how many values a column has."""
TIME_WEIGHT = 0.85
"""Weight of stretches of time in the order: a slow residual is large somewhere by chance; what recurs says more."""
COLUMN_WEIGHT = 0.8
"""Weight of recorded columns in the order: a temperature or an hour is less easily right by chance."""
PLACES_BEYOND = 3.0
"""Error beyond the noise, in standard deviations of what noise alone shows. Below this, no place is shown."""
FEWEST_WITHIN = 3
"""Averages in a place below which nothing is said of it: their rms could be that of a single one."""
BAND = 4.0
"""Highest over lowest frequency of a band of the residual that is looked at."""
FEWEST_AVERAGES = 64
"""Averages below which no bands of frequency are looked at: there would be two, a factor of four each."""
