"""Exports for the tests in the form of instruments' programs, with computed numbers."""

from collections.abc import Sequence

SETTINGS = """Collection Time: {when}
Operator Name  :
Scan Software Version: 4.20(468)
Parameter List :
Instrument                        Cary 5000
Start (nm)                        {start:.2f}
Stop (nm)                         {stop:.2f}
X Mode                            Nanometers
Y Mode                            {mode}
UV-Vis Data Interval (nm)         {step:.3f}
UV-Vis SBW (nm)                   2.000
Beam Mode                         Double
Baseline Correction               On
Comments
Method Log     :
Method Name    : Default
Date/Time stamp: {when}
End Method Modifications
<SBW (nm)> , 2.00
<Slit height> , Full
"""


def cary(
    traces: Sequence[tuple[str, str, int]],
    *,
    start: float = 900.0,
    step: float = 5.0,
    points: int = 40,
    log: bool = True,
    value: float = 91.0,
) -> str:
    """Return a Cary export; a trace is given by its name, its mode, and the number of points that it lacks."""
    head = ",".join(f"{name}," for name, _, _ in traces) + ","
    modes = ",".join(f"Wavelength (nm),{mode}" for _, mode, _ in traces) + ","
    levels = [(value + 0.37 * trace) * (0.02 if mode == "Abs" else 1.0) for trace, (_, mode, _) in enumerate(traces)]
    rows = [
        "".join(
            _pair(start - step * n, level, n, points - short) + ","
            for level, (_, _, short) in zip(levels, traces, strict=True)
        )
        for n in range(points)
    ]
    lines = [head, modes, *rows]
    if log:
        stop = start - step * (points - 1)
        for name, mode, _ in traces:
            when = "3/17/2021 1:45:42 PM"
            lines += ["", f"{name},", name]
            lines += SETTINGS.format(when=when, start=start, stop=stop, step=step, mode=mode).splitlines()
    return "\r\n".join(lines) + "\r\n"


def _pair(wave: float, level: float, n: int, points: int) -> str:
    return f"{wave:.10g},{level + 0.013 * n + 1e-5 * n * n:.10g}" if n < points else ","


TRA_HEAD = """"aktuelle Probe"\t"4"
"Einspannlänge"\t50.02\t"mm"
"Messlänge"\t"nicht bekannt"
"Probenbreite b0"\t10.1\t"mm"
"Probendicke a0"\t2.05\t"mm"
"Prüfgeschwindigkeit"\t20\t"mm/min"
"E-Modul"\t3.41\t"N/mm²"
"Kraftmaximum"\t1.725\t"N/mm²"
"Bruchkraft"\t"nicht bekannt"
"Datum"\t"05.03.2021"
"Prüfzeit"\t"Standardweg"\t"Standardkraft"\t"Dehnung"\t"Traverse abs."
"s"\t"mm"\t"N"\t"%"\t"mm"
"""


def tensile(points: int = 120) -> str:
    """Return a German testXpert export of a tension test, with tabs."""
    rows = []
    for n in range(points):
        time = 0.02 + 0.05 * n
        travel = 6.0e-5 * (n == 0) + time / 3.0 * (n > 0)
        force = 0.2 + 1.3 * travel - 0.004 * travel * travel
        cells = (f"{time:.6g}", _c_number(travel), f"{force:.6g}", _c_number(travel * 2.0), f"{785.2 + travel:.6g}")
        rows.append("\t".join(cells))
    return TRA_HEAD + "\n".join(rows) + "\n"


def _c_number(value: float) -> str:
    """Return a number in the form of an older C library of Windows, with three digits in the exponent."""
    text = f"{value:.6g}"
    mantissa, mark, exponent = text.partition("e")
    return text if not mark else f"{mantissa}e{exponent[0]}{int(exponent[1:]):03d}"
