"""Records to try things on, simulated and measured."""

from ._devices import Device
from ._heat import HeatStack, Layer
from ._real import fetch_real_record, list_real_records, load_real_record
from ._simulated import make_record
from ._voltage import load_voltage_reference

__all__ = [
    "Device",
    "HeatStack",
    "Layer",
    "fetch_real_record",
    "list_real_records",
    "load_real_record",
    "load_voltage_reference",
    "make_record",
]
