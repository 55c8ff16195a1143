"""The header of an export: flags, columns, state, functions."""

from __future__ import annotations

from .finished import Firmware
from .language import comment


def header(firmware: Firmware, provenance: list[str]) -> str:
    """Text of `<name>.h`."""
    t, T = firmware.target, firmware.target.dtype
    flags = [f"#define {t.macro(name)} {bit}u /* {text} */" for name, bit, text in firmware.flags()]
    columns = [
        f"    {t.macro('COLUMN_' + name)} = {i}, /* {comment(column)} */"
        for i, (column, name) in enumerate(firmware.program.columns.items())
    ]
    if columns:
        columns = ["enum {", *columns, f"    {t.macro('COLUMNS')} = {len(columns)}", "};", ""]
    members = [
        f"    {m.ctype} {m.name}{'' if m.length is None else f'[{m.length}]'}; /* {comment(m.comment)} */"
        for m in firmware.members()
    ]
    guard = t.macro("H")
    return "\n".join(
        [
            "/*",
            *(f" * {comment(line)}".rstrip() for line in provenance),
            " */",
            f"#ifndef {guard}",
            f"#define {guard}",
            "",
            "#include <stdint.h>",
            "",
            "#ifdef __cplusplus",
            'extern "C" {',
            "#endif",
            "",
            *flags,
            "",
            *columns,
            "typedef struct {",
            *members,
            f"}} {t.name}_state;",
            "",
            f"#define {t.macro('STATE_BYTES')} {firmware.state_bytes}u",
            *([f"#define {t.macro('PERIOD_S')} {t.number(t.period)} /* between samples */"] if t.period else []),
            "",
            "typedef struct {",
            f"    {T} bias;      /* what temperature and the other causes add to the reading, its unit */",
            f"    {T} corrected; /* reading - bias, eq. (24) */",
            "    uint32_t flags; /* why the result deserves no trust; 0: it does */",
            f"}} {t.name}_result;",
            "",
            *_documentation(firmware),
            f"{firmware.init_signature()};",
            "",
            f"{firmware.update_signature()};",
            "",
            "#ifdef __cplusplus",
            "}",
            "#endif",
            "",
            "#endif",
            "",
        ]
    )


def _documentation(firmware: Firmware) -> list[str]:
    """How to call the two functions."""
    t = firmware.target
    said = [
        "/* Call init once, then update for every sample, also where an input is missing (NaN): its last good value",
        " * stands in. After a long outage, or when the device was moved, call init again.",
    ]
    if t.continues:
        said.append(f" * The first sample follows the last fitted row by {'one period' if t.fixed else 'its step'}.")
    elif firmware.clock.used:
        unit = f"samples of {t.period:.10g} s" if t.fixed else "microseconds"
        first = "first sample" if t.fixed else "call of init, from which the first step counts"
        said.append(f" * start: {unit} from the first fitted row to the {first}.")
        if t.history is not None and t.history.kind.startswith("datetime"):
            said.append(f" * First fitted row: {t.absolute_zero():.6f} s since 1970 (UTC, or local without a zone).")
    if not t.fixed:
        said.append(" * step_us: microseconds since the update before.")
        if t.longest_step is not None:
            said.append(
                f" * A step longer than {t.longest_step:.10g} s starts a new segment, as max_gap did in the fit."
            )
    if firmware.program.columns:
        said.append(" * columns: recorded columns in the order of the enum above, in their fitted units.")
    said[-1] += " */"
    return said
