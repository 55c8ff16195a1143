"""Measured records, read from a folder that the user names; none of their files is part of the package."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

_VARIABLE = "THERMOCORR_RECORDS"
_PEPAS = "J. Pepas, github.com/cellularmitosis/logs, MIT"


@dataclass(frozen=True)
class _Record:
    physics: str
    reading: str
    temperature: str
    hidden: str
    hidden_columns: tuple[str, ...]
    license: str
    source: str
    run_column: str | None = None


_RECORDS = {
    "vhd200_resistor": _Record(
        physics="Oil-filled 1 kOhm foil resistors in a temperature chamber.",
        reading="resistance_ohm",
        temperature="oven_temp_degC",
        hidden="room temperature, acting on the meter",
        hidden_columns=("ambient_temp_degC",),
        license="MIT, Copyright (c) 2018 Jason Pepas",
        source=_PEPAS,
        run_column="run",
    ),
    "hp34420a_nanovoltmeter": _Record(
        physics="7.5-digit nanovoltmeter in an air bath, three ranges.",
        reading="dut_ch1_V",
        temperature="bath_temp_degC",
        hidden="room temperature, acting on source and cabling",
        hidden_columns=("room_temp_degC",),
        license="MIT, Copyright (c) 2025 TiN",
        source="I. Tsemenko, github.com/tin-/tckit",
        run_column="range",
    ),
    "oldtown_soil": _Record(
        physics="Soil at 5 and 25 cm below a forest, hourly, 3.5 years.",
        reading="soil_temp_5cm_degC",
        temperature="air_temp_degC",
        hidden="freezing at 0 degC (hinge of the air temperature, lagged); snow",
        hidden_columns=("snow_depth_cm",),
        license="CC0 1.0",
        source="github.com/Contosta/Old-Town-Met-Data",
    ),
    "dmm_box_heater": _Record(
        physics="Air in a box with a meter and a controlled heater.",
        reading="box_temp_degC",
        temperature="room_temp_degC",
        hidden="heater power (current squared), lagged",
        hidden_columns=("heater_current_sq_A2",),
        license="MIT, Copyright (c) 2018 Jason Pepas",
        source=_PEPAS,
        run_column="run",
    ),
    "gr1433_resistor": _Record(
        physics="100 kOhm decade box and its meter in a room.",
        reading="resistance_ohm",
        temperature="room_temp_degC",
        hidden="none certain; humidity is a weak candidate",
        hidden_columns=(),
        license="MIT, Copyright (c) 2018 Jason Pepas",
        source=_PEPAS,
    ),
}


def list_real_records() -> pd.DataFrame:
    """List the measured records that `load_real_record` knows.

    Returns
    -------
    records : DataFrame
        One row per record, the index is its name; columns physics, reading, temperature, hidden, license,
        source and run_column.
    """
    rows = {
        name: {key: value for key, value in vars(record).items() if key != "hidden_columns"}
        for name, record in _RECORDS.items()
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("name")


def load_real_record(
    name: str, folder: str | os.PathLike[str] | None = None, *, run: str | None = None
) -> pd.DataFrame:
    """Load a measured record, as recorded, from a folder that holds `<name>/<name>.csv`.

    The records, their physics and where they come from:

    - "vhd200_resistor": oil-filled 1 kOhm foil resistors follow their chamber with minutes to an hour of lag; the room
      acts on the meter. J. Pepas, 2018, MIT. Runs "run9", "run10", "run15", "run17".
    - "hp34420a_nanovoltmeter": a 7.5-digit meter with hours of thermal mass in an air bath; the room acts on source and
      cabling; humidity and pressure are decoys. I. Tsemenko, 2024, MIT. Runs (ranges) "1V", "100mV", "10mV".
    - "oldtown_soil": heat conducted from the air into forest soil, 5 and 25 cm deep; freezing and snow disturb it.
      Old Town, Maine, 2018-2022, CC0.
    - "dmm_box_heater": air in a box follows the room; a heater in closed loop warms it by its current squared.
      J. Pepas, 2022, MIT. Runs "log10.2", "log11.2"; times are the column time_s [s] of each run.
    - "gr1433_resistor": a decade box of 100 kOhm and its meter follow the room by minutes to hours.
      J. Pepas, 2018, MIT.

    Parameters
    ----------
    name : str
        One of the names above.
    folder : path-like, optional
        Folder of the records. By default the one named by the environment variable THERMOCORR_RECORDS.
    run : str, optional
        Return only this run (range, for the nanovoltmeter).

    Returns
    -------
    record : DataFrame
        Columns and order of rows as in the file, units in the columns' names. The index is a DatetimeIndex
        named "time", with its time zone where one is recorded; for "dmm_box_heater" it is a RangeIndex.
        `record.attrs` holds "name", "reading", "temperature", "hidden", "hidden_columns", "run_column",
        "license" and "source".

    Raises
    ------
    ValueError
        If the name or the run is unknown, or no folder is given.
    FileNotFoundError
        If the folder or the record's file does not exist.
    """
    if name not in _RECORDS:
        raise ValueError(f"There is no record {name!r}. The records are: {', '.join(_RECORDS)}.")
    about = _RECORDS[name]
    frame = pd.read_csv(_find(name, folder))
    if run is not None:
        frame = _only_run(frame, name, about.run_column, run)
    if "time" in frame.columns:
        frame["time"] = pd.to_datetime(frame["time"])
        frame = frame.set_index("time")
    frame.attrs = {"name": name, **{key: value for key, value in vars(about).items() if key != "physics"}}
    frame.attrs["hidden_columns"] = list(about.hidden_columns)
    return frame


def _find(name: str, folder: str | os.PathLike[str] | None) -> Path:
    chosen = folder if folder is not None else os.environ.get(_VARIABLE)
    if not chosen:
        raise ValueError(
            f"No folder of records is known. Pass folder=..., the folder that holds {name}/{name}.csv, or "
            f"set the environment variable {_VARIABLE} to it."
        )
    root = Path(chosen)
    if not root.is_dir():
        raise FileNotFoundError(
            f"The folder of records {str(root)!r} does not exist. Pass folder=..., the folder that "
            f"holds {name}/{name}.csv."
        )
    candidates = (root / name / f"{name}.csv", root / f"{name}.csv")
    for path in candidates:
        if path.is_file():
            return path
    present = [other for other in _RECORDS if (root / other / f"{other}.csv").is_file()]
    raise FileNotFoundError(
        f"The folder {str(root)!r} holds no {name}/{name}.csv. Records found there: "
        f"{', '.join(present) or 'none'}. Pass the folder that holds it as folder=..."
    )


def _only_run(frame: pd.DataFrame, name: str, column: str | None, run: str) -> pd.DataFrame:
    if column is None:
        raise ValueError(f"The record {name!r} has no runs. Got run={run!r}; leave it out.")
    known = list(dict.fromkeys(frame[column].astype(str)))
    if run not in known:
        raise ValueError(f"The record {name!r} has no run {run!r}. Its runs are: {', '.join(known)}.")
    return frame[frame[column].astype(str) == run].reset_index(drop=True)
