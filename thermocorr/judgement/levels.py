"""Thresholds of the judgement, with their evidence.

What changes when one of them is halved or doubled is printed by `benchmarks/value.py --level NAME=VALUE`. The campaigns
behind them are `benchmarks/hidden_effects.py` (simulated devices), `benchmarks/null_records.py` (nothing hidden,
thirteen kinds of noise), `benchmarks/planted_on_real.py` (known effects on measured backgrounds) and
`benchmarks/real_records.py --refine`.
"""

from __future__ import annotations

# What is left

PROVABLE = 12.0
"""Log likelihood that a drift or step gains on the average where it is proven half of the time: the level, for a family
of seven hundred tests (chi-square, one degree of freedom)."""
DRIFT_TO_STEP, DRIFT_TO_NOISE = 7.0, 3.0
"""The smallest drift that could be seen, over the smallest step and over a reading's noise, at which drifts hide in
what the model has. In ordinary records the smallest drift is two to four steps, in few steps of a chamber up to 26."""
RANKED = 10
"""Suspects that are listed at most, causes among them."""
FILTER_LENGTH, FILTER_WHITE = (15.0, 2.0), 0.1
"""Memory of a filter's noise at most [samples], without white noise and with some; share of all that is some."""
TAILS = 3.0
"""Rms of the residual over its usual size (nine tenths of Gaussian noise are below 1.645), at which a few readings
make most of it. Student's t with three degrees has 1.2, one reading in thirty of sixty times the size 10."""

# Where it fails

PLACES = 12
"""Stretches of time, ranges of a condition, and parts of a day that the residual is looked at in."""
PLACES_BEYOND = 3.0
"""Error beyond the noise, in standard deviations of what noise alone shows. Below this, no place is shown."""

# What is looked at

MOST_ROWS = 4_000_000
"""Rows of a record that is judged, at most: all of them are in memory."""
MOST_SOUND = 0.95
"""Share of a recorded column's numbers that must be numbers for it to be a suspect."""
FINE = 25_000
"""Stretches that a record is averaged over at most. A delay of a few samples is blurred in long averages: with 12 000,
a second, neighbouring delay is named besides the true one in two of seven simulated records, not in one."""
FEWEST = 100
"""Readings below which a record is too short to judge: there are about twenty columns in the base."""
LAGS = 14
"""Lags of the thermal part that suspects are judged given, evenly in the logarithm, with the model's own. A
poorer part makes other effects look guilty."""
SLOWEST = 0.1
"""Slowest lag of the base, as a share of all segments together; none is slower than the longest segment. Slower ones
take drift, ageing and slow columns upon themselves: they are suspects instead."""
STARTS = 7
"""Decays of the start of a segment that suspects are judged given: the model's own few leave what bodies between and
beyond them keep of the time before. In 300 runs of an hour that was a hysteresis."""
BEYOND = 2.0
"""How far they reach beyond the model's fastest and slowest, as a factor."""
START_HELD = 0.03
"""Size of a direction that they span, over that of the first, below which it is left out: each takes of slow causes. In
300 runs all that thirteen decays span hid a humidity, and two directions left a hysteresis that was not there."""
LEAST_OWN = 0.1
"""Share of a wave, or of a law that changes at a row, outside the base, below which its gain is unknown."""
LATEST = 0.01
"""Longest delay that is looked for, as a share of the longest segment. Longer ones are much like slow lags."""
SHORTEST_STRETCH = 8
"""Rows of the shortest disturbance that is looked for, however it is tuned. With 5, three large readings of heavy tails
(Student, three degrees) that follow on one another were taken for a disturbance in one of twelve records."""
SHORTEST_START = 4.0
"""Fastest start-up decay that is looked for, in rows, however it is tuned: it lasts for as many as `SHORTEST_STRETCH`.
Of 300 records with heavy tails, three whose first reading was a large one were said to have a start
(`benchmarks/null_records.py --records 300 --first 140000 --kinds "heavy tails"`)."""
LONGEST_STRETCH = 0.05
"""Longest disturbance that is looked for, as a share of the record: what lasts longer is two steps."""
LENGTHS = 1.25
"""Ratio of successive trial lengths: a stretch between two of them keeps nine tenths of its gain, and is then moved."""
STRETCHES = 40
"""Tests that the search for a disturbance counts for, per row of the record. White noise asks for 4.0 to 5.3 (largest
gain of 400 records of 2 500 and of 10 000 rows); noise that wanders has excursions that look like one: with 5, 6 of 450
records of flicker and noise that remembers 30 or 100 rows had a p-value of .001 or less
(`benchmarks/null_records.py --records 150 --first 70000 --kinds flicker "2 %" "30 rows"`)."""
FAR = 8.0
"""Distance of a row from the median of five around it, in robust standard deviations of such distances, beyond which it
is not judged: six standard deviations of white noise, which two million rows of it do not reach. Where one reading in
a hundred is wrong by 25 standard deviations, too many to be taken for spikes, steps there and back were named in one of
sixteen records."""
FEW = 0.03
"""Share of rows that may stand out so: more are no glitches but the noise itself, which then has few values."""
OUTSTANDING = 3.0
"""Distance from the median of those around it, in robust standard deviations, beyond which a reading counts no more for
a disturbance. Without a limit, two of four records with heavy tails (Student, three degrees of freedom) and one of four
with bursts were said to have short disturbances."""
AROUND = 33
"""Rows of that median: the shortest disturbance must not move it. With 5, three to five large readings of heavy tails
that follow on one another moved it, and were named in three of 240 records, with 33 in none."""

# Likelihood

ROUNDED = 1e-7
"""Size of a direction of columns of unit length, over that of the largest, below which it is rounding error."""
VISIBLE = 0.1
"""Size that a law of the record's own strength has in a direction of the base, over the noise from row to row, below
which the base does without it: coefficients ten times those of the law would hardly show there. Without this, what a
delay planted on measured records makes was in the base of 22 lags, with coefficients that no device has. With 0, 0.1,
90.4, 95.7 % of 230 plants are declared (`benchmarks/planted_on_real.py`)."""
ALIVE = 1e-4
"""Length of a column outside the base, over its whole length, below which it is nothing new."""
BATCH = 24
"""Explanations that are transformed at a time, so that their columns stay near the processor: twice as fast."""
QUIET = 0.03
"""Wandering noise that a second start of the estimate has, over the first: a slow cause is invisible where the noise
has taken it upon itself, so each explanation may also begin with hardly any."""

INFLATION = 1.5
"""What the copies gain, over what noise that is as it seems would give them, up to which evidence counts in full:
chance gives more once in forty (chi-square, as many degrees of freedom as copies). Besides columns planted on measured
records that were found it is 0.6 to 1.8, but 10 to 35 where a record's own law was taken for another column's."""

# Later data

HELPFUL = 3.0
"""Fall [dB], on later stretches and on held-out blocks, at which a recorded column that the likelihood does not prove
is taken in, or the model's own lags are lacking: half of the squared error."""
NEARLY = 0.75
"""Share of the greatest fall on later stretches at which an explanation is nearly as good: the likelihood decides."""
SPEAKS = -6.0
"""Score (log likelihood) below which an explanation is rejected, however much it helps on later data."""

# Decisions

LEVEL = 0.001
"""P-value of the whole family below which a cause is proven."""
LOOKS = 4.5
"""Factor on the number of tests: parameters are tuned beyond their list, and the noise is an estimate. Of 720 records
of coloured noise 1.5 % have a p-value of .01 or less, 2.4 % with a factor of 3 (`benchmarks/null_records.py
--records 60 --kinds flicker "0.3 %" "3 rows" "2 %"`, `--first` 9400, 9900 and 10400)."""
DIFFERENT = 12
"""Most tests that the candidates of one kind and column count for: neighbours on a grid say nearly the same."""
MOMENTS = 3.68
"""Fall of the log likelihood up to which a step, another law or a disturbance may begin at another moment: 95 %, see
`thermocorr.judgement.report`."""
TIE = 4.0
"""Difference of scores (log likelihood) below which two explanations cannot be distinguished: odds of 55 to 1."""
ALIKE = 0.5
"""Share of what a cause makes of the reading that a rival could make as well, above which the two are rivals.
Explanations that are as good but say something else are further causes."""
FRUITLESS = 3
"""Terms in a row that are worth nothing, after which no further one is looked for."""
OF_THERMOMETER = 2.0
"""Structure that is left over what the errors of the thermometers make in the reading, up to which these are its cause.
On simulated devices whose thermometers have noise of 0.05 or 0.1 K it is 1.0 to 1.2 on the average, with 0.02 K up to
1.6, with steps of 0.0625 to 0.25 K 0.6 to 1.3 (`benchmarks/thermometer_noise.py --diagnose`)."""
STRUCTURE = 12.0
"""Log likelihood of wandering noise over white noise, given everything else, at which structure is left: for eight
parts, 12 has a p-value of 0.002."""
ROUNDED_OFF = 1.5
"""What is left over the usual rounding error of the reading (its step over the root of 12), up to which it is that."""
SEVERAL = 3
"""Steps at which they are one cause, several steps."""

# Tuning

SHARES = (0.5, 0.25, 0.1, 0.03)
"""How far parameters are moved, coarse to fine, in a search around the best of each kind."""
