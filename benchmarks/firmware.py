"""Exported C against Python for every kind of effect: errors, costs, sizes on a Cortex-M4, sanitizers, valgrind, Arm.

    python benchmarks/firmware.py --rows 1000000

Errors are the largest difference between the C code's bias and the model's over all rows, as a share of the range of
the bias; in single precision both get the same inputs, rounded to it. "new": a device that starts ten days after the
fitted record; "follows": one that goes on where the fit ended. A tool that is not installed is named and left out.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from firmware_runs import KINDS, PERIOD, WARNINGS, compile_c, errors, fitted, later, run_c, start_of, tool

from thermocorr.firmware import export_c

CORTEX_M4 = ("-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard", "-Os", "-ffunction-sections")
SANITIZED = ("gcc", "-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
ARM = ("arm-linux-gnueabihf-gcc", "-O2", "-static", "-mfpu=vfpv4", "-ffp-contract=fast")
WAYS = {
    "fixed, new": (False, False),
    "fixed, follows": (False, True),
    "variable, new": (True, False),
    "variable, follows": (True, True),
}


def accuracy(kind: str, model, X, folder: Path, rows: int) -> dict[str, float]:
    """Errors of all ways to run, in both precisions."""
    found = {}
    for dtype in ("double", "float"):
        for way, (variable, follows) in WAYS.items():
            if variable and kind.startswith("delay"):
                continue  # refused by name
            kelvin = KINDS[kind].get("kelvin", False)
            found[f"{dtype}, {way}"] = errors(model, X, folder, dtype, rows, variable, follows, kelvin)[0]
    return found


def costs(model, folder: Path) -> dict[str, object]:
    """State, constants and operations of the single-precision export at a fixed step, and its size on a Cortex-M4."""
    export = export_c(model, folder / "bias.c", sampling_period=PERIOD)
    o = export.operations
    result = {
        "state": export.state_bytes,
        "constants": export.constant_bytes,
        "multiply-adds": o.multiply_adds,
        "adds": o.adds,
        "divisions": o.divisions,
        "libm": o.calls,
    }
    if tool("arm-none-eabi-gcc"):
        built = folder / "bias.o"
        command = ["arm-none-eabi-gcc", *CORTEX_M4, *WARNINGS, "-c", export.paths[1], "-o", built]
        subprocess.run(command, check=True)
        sizes = subprocess.run(["arm-none-eabi-size", built], check=True, capture_output=True, text=True).stdout
        text, data, bss, *_ = (int(word) for word in sizes.splitlines()[1].split()[:3])
        assert data == bss == 0  # all that changes is in the caller's state
        result["M4 text"] = text
    return result


def soundness(model, X, folder: Path, rows: int) -> dict[str, str]:
    """Every compiler and checker that is there, with missing inputs strewn in."""
    said = {}
    new = later(model, X, rows)
    new.iloc[::97, 0] = np.nan
    new.iloc[5::101] = np.inf
    for dtype in ("float", "double"):
        for variable in (False, True):
            try:
                export = export_c(model, folder / "bias.c", dtype, sampling_period="variable" if variable else PERIOD)
            except ValueError:
                continue
            start = start_of(export, X, new)
            runs = {"gcc": (("gcc", "-O2"), (), rows), "sanitizers": (SANITIZED, (), rows)}
            if tool("clang"):
                runs["clang"] = (("clang", "-O2", "-Wsign-conversion"), (), rows)
            if tool("valgrind"):
                checker = ("valgrind", "--error-exitcode=9", "--leak-check=full", "--track-origins=yes", "-q")
                runs["valgrind"] = (("gcc", "-g", "-O1"), checker, 1000)
            biases = {}
            for name, (command, before, n) in runs.items():
                run = run_c(compile_c(export, command, start), new[:n], np.ones(n), export.columns, before)
                biases[name] = run.bias[:1000]
                said[name] = "clean"
            spread = np.ptp(biases["gcc"])
            differ = max(np.abs(bias - biases["gcc"]).max() / spread for bias in biases.values())
            assert differ < (1e-6 if dtype == "float" else 1e-13), differ
    return said


def emulated(kind: str, model, X, folder: Path, rows: int) -> dict[str, float]:
    """The same comparison on an emulated 32-bit Arm; both precisions, and the self-test."""
    found = {}
    for dtype in ("double", "float"):
        kelvin = KINDS[kind].get("kelvin", False)
        error, export, *_ = errors(model, X, folder, dtype, rows, kelvin=kelvin, command=ARM, before=("qemu-arm",))
        found[f"Arm {dtype}"] = error
        program = folder / "selftest"
        subprocess.run([*ARM, *WARNINGS, *export.paths[1:], "-o", program, "-lm"], check=True)
        subprocess.run(["qemu-arm", program], check=True, capture_output=True)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--checked-rows", type=int, default=20_000, help="rows for sanitizers and emulated Arm")
    parser.add_argument("--kinds", nargs="*", default=list(KINDS), choices=list(KINDS), metavar="KIND")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    for name in ("clang", "valgrind", "arm-none-eabi-gcc", "arm-linux-gnueabihf-gcc", "qemu-arm"):
        if tool(name) is None:
            print(f"{name} is not installed: what needs it is left out")
    with_arm = tool("arm-linux-gnueabihf-gcc") and tool("qemu-arm")
    exact, cost, sound = {}, {}, {}
    for kind in options.kinds:
        model, X = fitted(**KINDS[kind])
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder)
            exact[kind] = accuracy(kind, model, X, path, options.rows)
            cost[kind] = costs(model, path)
            sound[kind] = soundness(model, X, path, options.checked_rows)
            if with_arm:
                exact[kind] |= emulated(kind, model, X, path, options.checked_rows)
        print(f"{kind}: largest error {max(exact[kind].values()):.1e}", file=sys.stderr, flush=True)
    pd.set_option("display.width", 250, "display.max_columns", 30)
    print(f"\nLargest error over {options.rows} rows (Arm: {options.checked_rows}), share of the bias's range")
    print(pd.DataFrame(exact).T.to_string(float_format="{:.0e}".format, na_rep="refused"))
    print(
        "\nSingle precision, fixed step: bytes, operations for one sample, bytes of code and constants on a Cortex-M4"
    )
    print(pd.DataFrame(cost).T.to_string())
    print("\nWith missing inputs, both precisions, fixed and variable steps")
    print(pd.DataFrame(sound).T.to_string())


if __name__ == "__main__":
    main()
