"""A fitted model as a package for ESPHome: the C files, and the YAML that calls them once a sample."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..files import Outputs
from ..records.numbers import unit_text
from .c99 import C99
from .export import export_to
from .finished import FirmwareExport
from .target import one_line

YAML = """\
# {title}
# Put this file, {name}.h and {name}.c into the folder of your device's YAML, and write there:
#
#   packages:
#     {name}: !include {name}.yaml
#
# Say below, or in the substitutions of your YAML, what your sensors are called. State is kept over a restart; after a
# long time without power press the button, or wait until the lags forget: {washout:.0f} s.
{compensation}
substitutions:
{substitutions}
esphome:
  includes:
    - {name}.h
    - {name}.c

globals:
  - id: {memory}
    type: {name}_state
    restore_value: yes
    update_interval: 15min
  - id: {begun}
    type: bool
    restore_value: yes
    update_interval: 15min
    initial_value: "false"

sensor:
  - platform: template
    id: {name}_corrected
    name: "{label} corrected"
{unit}    accuracy_decimals: 3
    update_interval: {period:g}s
    lambda: |-
      if (!id({begun})) {{
        {name}_init(&id({memory}));
        id({begun}) = true;
      }}
      const float {name}_T = id(${{{temperature}}}).state, {name}_U = id(${{{reading}}}).state;
{columns}      const {name}_result {name}_found = {name}_update(&id({memory}), {name}_T, {name}_U{given});
      if ({name}_found.flags & ({flags})) return {{}};
      return {name}_found.corrected;

button:
  - platform: template
    name: "{label} correction: start anew"
    on_press:
      - lambda: {name}_init(&id({memory}));
"""
COMPENSATION = """\
#
# A SEN5x or SEN6x corrects itself with these numbers, fitted to the same log, where they leave {rms:.3g} {unit} rms.
# They are an alternative to this file, and replace it:
#
#   temperature_compensation:
#     offset: {offset:.3f}
#     normalized_offset_slope: {slope:.4f}
#     time_constant: {time_constant:.0f}
"""


class Compensation(NamedTuple):
    """Numbers by which a Sensirion SEN5x or SEN6x corrects its own temperature.

    It shows T + (offset + slope T) (1 - exp(-t / time_constant)), t being the time since it was switched on.
    Source: Sensirion, Temperature acceleration and compensation instructions for SEN5x.
    """

    offset: float
    """[K]"""
    slope: float
    time_constant: float
    """[s]; 0 where the log does not show one."""
    rms: float
    """What they leave in the log [K]."""


def temperature_compensation(reading: Any, reference: Any, seconds: Any) -> Compensation:
    """Fit a sensor's own compensation to a log that begins when it is switched on.

    Parameters
    ----------
    reading, reference : array-like of shape (n_rows,)
        What the sensor shows without compensation, and what is true [degC]; NaN where there is none.
    seconds : array-like of shape (n_rows,)
        Time since it was switched on [s].

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(0, 7200, 10.0)
    >>> true = 22 + np.sin(t / 900)
    >>> shown = (true + 2.0 * (1 - np.exp(-t / 600))) / (1 - 0.05 * (1 - np.exp(-t / 600)))
    >>> found = temperature_compensation(shown, true, t)
    >>> round(found.offset, 1), round(found.slope, 2), abs(found.time_constant - 600) < 30
    (-2.0, -0.05, True)
    """
    T, true, t = (np.asarray(values, float) for values in (reading, reference, seconds))
    known = np.isfinite(T) & np.isfinite(true)
    T, true, t = T[known], true[known], t[known]
    taus = [0.0, *np.geomspace(max(float(np.median(np.diff(t))), 1.0), max(float(t[-1]) / 4, 2.0), 60)]
    found = []
    for tau in taus:
        applied = np.ones(len(t)) if tau == 0 else -np.expm1(-t / tau)
        columns = np.column_stack((applied, applied * T))
        (offset, slope), *_ = np.linalg.lstsq(columns, true - T, rcond=None)
        left = true - T - columns @ (offset, slope)
        found.append(Compensation(float(offset), float(slope), float(tau), float(np.sqrt(np.mean(left**2)))))
    return min(found, key=lambda one: one.rms)


def export_esphome(
    model: Any,
    path: str | Path,
    *,
    name: str | None = None,
    compensation: Compensation | None = None,
    force: bool = False,
    inputs: Iterable[str | Path] = (),
) -> FirmwareExport:
    """Write a fitted model as C99 (`<name>.h`, `<name>.c`, self-test) and `<name>.yaml`, a package for ESPHome.

    Parameters
    ----------
    model, path, name, force, inputs : see `export_c`
        Numbers are of single precision; samples come at the fitted record's usual step.
    compensation : Compensation, optional
        Stands in the YAML as a comment.

    Returns
    -------
    FirmwareExport

    Raises
    ------
    ValueError, OutputError
        As `export_c`.
    """
    language = _Package(model, compensation)
    return export_to(language, model, path, "float", name=name, outputs=Outputs(inputs, force))


class _Package(C99):
    """C99, and the YAML of a package."""

    def __init__(self, model: Any, compensation: Compensation | None):
        super().__init__()
        self.model, self.compensation = model, compensation

    def files(self, firmware: Any, provenance: Any, trial: Any) -> dict[str, str]:
        """The C files, and `.yaml`."""
        texts = super().files(firmware, provenance, trial)
        name, reading = firmware.target.name, self.model.reading_
        columns = [str(column) for column in firmware.program.columns]
        ids = _identifiers((str(firmware.target.temperature_name), reading.name, *columns))
        digest = hashlib.blake2b(
            texts[".c"].encode(), digest_size=4
        ).hexdigest()  # another model has a state of its own
        own = reading.temperature_unit if reading.name == firmware.target.temperature_name else reading.unit
        unit = unit_text(own)
        ascii_unit = unit.encode("unicode_escape").decode()  # as YAML reads it too
        said = f'    unit_of_measurement: "{ascii_unit}"\n' if unit else ""
        temperature, shown = ids[str(firmware.target.temperature_name)], ids[reading.name]
        states = ", ".join(f"id(${{{ids[column]}}}).state" for column in columns)
        compensation = "" if self.compensation is None else COMPENSATION.format(**self.compensation._asdict(), unit="K")
        texts[".yaml"] = YAML.format(
            title=one_line(provenance[0]),
            name=name,
            memory=f"{name}_memory_{digest}",
            begun=f"{name}_begun_{digest}",
            washout=float(self.model.washout_),
            compensation=compensation,
            substitutions="".join(f"  {one}: {one}\n" for one in dict.fromkeys(ids.values())),
            label=one_line(reading.name).replace('"', "'"),
            unit=said,
            period=firmware.target.period,
            columns=f"      const float {name}_columns[] = {{{states}}};\n" if columns else "",
            temperature=temperature,
            reading=shown,
            given=f", {name}_columns" if columns else "",
            flags=f"{name.upper()}_NO_READING | {name.upper()}_NOT_STARTED",
        )
        return texts


def _identifiers(names: Iterable[str]) -> dict[str, str]:
    """Names as ESPHome's ids are (letters, digits and underscores), each another one."""
    ids: dict[str, str] = {}
    for name in names:
        plain = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_").lower()
        plain = plain if plain[:1].isalpha() and plain not in RESERVED else f"sensor_{plain}".rstrip("_")
        taken = {one for other, one in ids.items() if other != name}
        ids[name] = plain if plain not in taken else f"{plain}_{len(ids)}"
    return ids


RESERVED = frozenset((
    "sensor", "switch", "button", "number", "select", "light", "fan", "cover", "climate", "text", "time", "output",
    "display", "logger", "api", "wifi", "globals", "id", "int", "float", "bool", "char", "const", "static", "return",
    "if", "else", "for", "while", "new", "delete", "class",
))  # fmt: skip
"""Names of ESPHome and of C++ that are no ids."""
