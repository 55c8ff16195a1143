"""Measured records, from a folder or an address."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from ..records import RecordError
from ..records.errors import warn

_VARIABLE = "THERMOCORR_RECORDS"
_PEPAS = "J. Pepas, github.com/cellularmitosis/logs, MIT"
_PASTAS = "R. A. Collenteur and others, github.com/pastas/pastas"
_PASTAS_LICENSE = "MIT, Copyright (c) 2016-present R.A. Collenteur, M. Bakker, R. Calje, F. Schaars"


@dataclass(frozen=True)
class _Record:
    sha256: str
    """Checksum of the file behind the guide's figures."""
    physics: str
    reading: str
    temperature: str
    hidden: str
    hidden_columns: tuple[str, ...]
    license: str
    source: str
    run_column: str | None = None
    file: str | None = None
    """Where it stands in a folder of records; `<name>/<name>.csv` by default."""


_RECORDS = {
    "vhd200_resistor": _Record(
        sha256="56ea2ad35a3deb36e9075e4979c5ef264772d1e394a225d0ffb5731499356e85",
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
        sha256="c623dd1992dee25710a3126a82ffb5de56819649c4e32151acab2b69b8403db9",
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
        sha256="e4774bb5524c543c882ad5d341dcd48da4c8f3ce281205f71ee459eeaf9f7138",
        physics="Soil at 5 and 25 cm below a forest, hourly, 3.5 years.",
        reading="soil_temp_5cm_degC",
        temperature="air_temp_degC",
        hidden="freezing at 0 degC (hinge of the air temperature, lagged); snow",
        hidden_columns=("snow_depth_cm",),
        license="CC0 1.0",
        source="github.com/Contosta/Old-Town-Met-Data",
    ),
    "dmm_box_heater": _Record(
        sha256="a3c72296a4b2606ae4aa78bde7c0a6c47e0dccf95ba4cf318a650380c9f1fcdb",
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
        sha256="3151d284a367a783f3c20037f93467d12990141d2f53040bc43a88833730d4e8",
        physics="100 kOhm decade box and its meter in a room.",
        reading="resistance_ohm",
        temperature="room_temp_degC",
        hidden="none certain; humidity is a weak candidate",
        hidden_columns=(),
        license="MIT, Copyright (c) 2018 Jason Pepas",
        source=_PEPAS,
    ),
    "groundwater_river": _Record(
        sha256="a80cbc42bdf20cd539a4644910783583d5f4ae37bce3698611b6155411f96547",
        physics="Head of groundwater, which follows recharge late; daily, 20 years.",
        reading="head_m",
        temperature="recharge_mm",
        hidden="a river, lagged",
        hidden_columns=("river",),
        license=_PASTAS_LICENSE,
        source=_PASTAS,
        file="groundwater_heads/river.csv",
    ),
    "groundwater_well": _Record(
        sha256="ad1e72ab491fac35ae87fd6309c52e773e0d0eb6804041ac147b892713e487c6",
        physics="Head of groundwater, which follows recharge late; daily, 23 years.",
        reading="head_m",
        temperature="recharge_mm",
        hidden="a well that is pumped, lagged",
        hidden_columns=("well",),
        license=_PASTAS_LICENSE,
        source=_PASTAS,
        file="groundwater_heads/well.csv",
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
        name: {key: value for key, value in vars(record).items() if key not in ("hidden_columns", "sha256", "file")}
        for name, record in _RECORDS.items()
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("name")


def load_real_record(
    name: str, folder: str | os.PathLike[str] | None = None, *, run: str | None = None
) -> pd.DataFrame:
    """Load a measured record from ``<name>/<name>.csv``.

    Warns (`RecordWarning`) where the file is not the one at which the guide's figures come.

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
    - "groundwater_river", "groundwater_well" (of groundwater_heads/river.csv and well.csv): heads that follow recharge
      through exponential responses; a river, or a well, is hidden; other rivers and a temperature are decoys.
      R. A. Collenteur and others, MIT.

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
    about, path = _RECORDS[name], _find(name, folder)
    if hashlib.sha256(path.read_bytes()).hexdigest() != about.sha256:
        warn(
            f"{path} is not the file that the figures of the guide come from: its SHA-256 is another one. Expect other "
            "figures."
        )
    frame = pd.read_csv(path)
    if run is not None:
        frame = _only_run(frame, name, about.run_column, run)
    if "time" in frame.columns:
        frame["time"] = pd.to_datetime(frame["time"])
        frame = frame.set_index("time")
    frame.attrs = {
        "name": name,
        **{key: value for key, value in vars(about).items() if key not in ("physics", "sha256", "file")},
    }
    frame.attrs["hidden_columns"] = list(about.hidden_columns)
    return frame


def fetch_real_record(
    name: str, url: str, folder: str | os.PathLike[str] | None = None, *, run: str | None = None
) -> pd.DataFrame:
    """Load a measured record, fetched first if need be.

    What comes is checked by its SHA-256 and kept in the folder: later calls need no network. Needs pooch (extra
    "records").

    Parameters
    ----------
    name : str
        See `load_real_record`.
    url : str
        Address of a folder of records: where your laboratory, or a release of this project, keeps them.
    folder : path-like, optional
        Where files are kept; by default the one named by the environment variable THERMOCORR_RECORDS, else a folder of
        your user's cache.
    run : str, optional
        See `load_real_record`.

    Returns
    -------
    record : DataFrame
        As `load_real_record` returns it; `record.attrs` has "license" and "source".

    Raises
    ------
    RecordError
        Where nothing can be fetched (no network, no such file there), and for a file with another SHA-256.
    ImportError
        Without pooch.
    """
    try:
        import pooch  # type: ignore[import-untyped]  # it has no types
    except ImportError:
        raise ImportError("Records are fetched by pooch: pip install pooch.") from None
    if name not in _RECORDS:
        raise ValueError(f"There is no record {name!r}. The records are: {', '.join(_RECORDS)}.")
    root = Path(folder or os.environ.get(_VARIABLE) or pooch.os_cache("thermocorr"))
    place = Path(_place(name))
    address = f"{url.rstrip('/')}/{place.as_posix()}"
    try:
        pooch.retrieve(address, f"sha256:{_RECORDS[name].sha256}", fname=place.name, path=root / place.parent)
    except ValueError as error:  # of pooch: the checksum
        raise RecordError(f"{address} is not the record {name!r}: its SHA-256 is another one. ({error})") from None
    except OSError as error:  # those of requests are, too
        raise RecordError(
            f"{address} cannot be fetched: {' '.join(str(error).split())}. Is there a network, and is this the address "
            "of a folder of records?"
        ) from None
    return load_real_record(name, root, run=run)


def _find(name: str, folder: str | os.PathLike[str] | None) -> Path:
    chosen = folder if folder is not None else os.environ.get(_VARIABLE)
    if not chosen:
        raise ValueError(
            f"No folder of records is known. Pass folder=..., the folder that holds {_place(name)}, or "
            f"set the environment variable {_VARIABLE} to it."
        )
    root = Path(chosen)
    if not root.is_dir():
        raise FileNotFoundError(
            f"The folder of records {str(root)!r} does not exist. Pass folder=..., the folder that "
            f"holds {_place(name)}."
        )
    candidates = (root / _place(name), root / Path(_place(name)).name)
    for path in candidates:
        if path.is_file():
            return path
    present = [other for other in _RECORDS if (root / _place(other)).is_file()]
    raise FileNotFoundError(
        f"The folder {str(root)!r} holds no {_place(name)}. Records found there: "
        f"{', '.join(present) or 'none'}. Pass the folder that holds it as folder=..."
    )


def _place(name: str) -> str:
    """Path of a record in a folder."""
    return _RECORDS[name].file or f"{name}/{name}.csv"


def _only_run(frame: pd.DataFrame, name: str, column: str | None, run: str) -> pd.DataFrame:
    if column is None:
        raise ValueError(f"The record {name!r} has no runs. Got run={run!r}; leave it out.")
    known = list(dict.fromkeys(frame[column].astype(str)))
    if run not in known:
        raise ValueError(f"The record {name!r} has no run {run!r}. Its runs are: {', '.join(known)}.")
    return frame[frame[column].astype(str) == run].reset_index(drop=True)
