"""Files in the form of further programs, as described by published readers, with computed numbers.

Jasco: WrightTools (from_JASCO) and JASCOFiles.jl. PerkinElmer .asc: hyperSpec and Bev.IO.PerkinElmerAsciiReader.
Thorlabs: pyIVLS, which imitates files of ThorSpectra. Avantes: lightr and converters of AvaSoft text. MTS TestSuite:
readers of its "DAQ- Crosshead, … - (Timed)" files, CSV and text. Lloyd NEXYGEN: its columns only. MTS 793: readers of
files that begin with ``MTS793|MPT|ENU|...``. Trapezium: snpl. Bluehill: its raw data.
"""

import math

WAVES = [400.0 + 2.0 * n for n in range(40)]
PERCENT = [round(85.0 + 5.0 * math.sin(n / 3.0), 3) for n in range(40)]
TIME = [round(0.1 * n, 2) for n in range(40)]
TRAVEL = [round(0.05 * n, 3) for n in range(40)]
FORCE = [round(1.3 * x - 0.01 * x * x, 4) for x in TRAVEL]


def jasco(separator: str = "\t", mark: str = ".") -> str:
    entries = {
        "TITLE": "film 1",
        "DATA TYPE": "ULTRAVIOLET SPECTRUM",
        "ORIGIN": "JASCO",
        "OWNER": "",
        "DATE": "26/03/01",
        "TIME": "10:22:33",
        "SPECTROMETER/DATA SYSTEM": "JASCO V-670",
        "DELTAX": "2",
        "XUNITS": "NANOMETERS",
        "YUNITS": "%T",
        "FIRSTX": f"{WAVES[0]:.4f}",
        "LASTX": f"{WAVES[-1]:.4f}",
        "NPOINTS": f"{len(WAVES)}",
        "FIRSTY": f"{PERCENT[0]:.3f}",
        "MAXY": f"{max(PERCENT):.3f}",
        "MINY": f"{min(PERCENT):.3f}",
    }
    head = [f"{key}{separator}{value}" for key, value in entries.items()]
    rows = [f"{wave:.4f}{separator}{value:.3f}" for wave, value in zip(WAVES, PERCENT, strict=True)]
    numbers = [line.replace(".", mark) for line in rows]
    head = [line.replace(".", mark) if line.startswith(("FIRST", "LAST", "MAX", "MIN")) else line for line in head]
    after = ["", "##### Extended Information", "[Comments]", f"Sample name{separator}film 1", ""]
    return "\r\n".join([*head, "XYDATA", *numbers, *after])


def perkin_elmer() -> str:
    head = ["PE UV       SUBTECH     SPECTRUM    ASCII       PEDS        4.00        ", "  -1", "film.sp"]
    head += ["26/03/01", "10:22:33.00", "26/03/01", "10:22:33.00", "operator", "film 1", "", "", "LAMBDA 950", "950N1"]
    head += ["2.03", "  0", "#HDR", "  -1", "  -1", "#GR", "nm", "%T", "1.0", "0.0", f"{WAVES[0]}", "2.0"]
    head += [f"{len(WAVES)}", "12", f"{max(PERCENT)}", f"{min(PERCENT)}", "#DATA"]
    return "\r\n".join([*head, *(f"{w:.6f}\t{t:.6f}" for w, t in zip(WAVES, PERCENT, strict=True)), ""])


def thorlabs() -> str:
    entries = {"Date": "20260301", "XAxisUnit": "nm_vac", "YAxisUnit": "dBm", "Average": "1", "Length": len(WAVES)}
    head = ["Thorlabs OSA", "#[SpectrumHeader]", *(f"#{key};{value}" for key, value in entries.items()), "[Data]"]
    return "\r\n".join([*head, *(f"{w:.6f};{-t:.6f}" for w, t in zip(WAVES, PERCENT, strict=True)), "[EndOfFile]", ""])


def avantes(mark: str = ".") -> str:
    head = ["film", "Integration time [ms]:  35.000", "Averaging Nr. [scans]: 10", "Smoothing Nr. [pixels]: 0"]
    head += ["Data measured with spectrometer [name]: 1204091U1"]
    head += ["Wave   ;Sample   ;Dark     ;Reference;Transmittance", "[nm]   ;[counts] ;[counts] ;[counts] ;[%]", ""]
    rows = [
        f"{w:7.2f};{900 + t:9.3f};{100.5:9.3f};{1200.25:9.3f};{t:9.5f}" for w, t in zip(WAVES, PERCENT, strict=True)
    ]
    return "\r\n".join([*head, *rows, ""]).replace(".", mark).replace(f"Nr{mark}", "Nr.")


def _columns(order: str, separator: str, first: int = 0) -> list[str]:
    columns = {"t": TIME, "x": TRAVEL, "F": FORCE}
    return [separator.join(f"{columns[letter][n]}" for letter in order) for n in range(first, len(TIME))]


def mts(blocks: int = 1) -> str:
    head = ["Data Acquisition\t\t\t\t\tTime:\t4.1\tSec\t3/1/2026 1:54:32 PM"]
    head += ["Running Time\tAxial Displacement\tAxial Force", "sec\tmm\tN"]
    rows, size = _columns("txF", "\t"), len(TIME) // blocks
    parts = ["\r\n".join([*head, *rows[size * n : size * (n + 1)], ""]) for n in range(blocks)]
    return "MTS793|MPT|ENU|1|2|.|/|:|1|0|0|A\r\n\r\n" + "\r\n".join(parts)


def trapezium(specimens: int = 2) -> str:
    names = [f"1 _ {n + 1}" for n in range(specimens)]
    lines = ['"Method","film.xmas"', '"Test mode","Tensile"', "", '"Name","Thickness","Width","Gauge_Length"']
    lines += ['"Units","mm","mm","mm"', *(f'"{name}","2.{n}","6.{n}","25.{n}"' for n, name in enumerate(names)), ""]
    for n, name in enumerate(names):
        lines += [
            f'"{name}","{name}","{name}"',
            '"Time","Force","Stroke"',
            '"sec","N","mm"',
            *_columns("tFx", ",", n),
            "",
        ]
    return "\r\n".join(lines)


def bluehill(specimens: int = 1) -> str:
    lines = [
        "Results Table 1",
        ",Maximum Load,Modulus",
        ",(N),(MPa)",
        *(f'{n + 1},"2.{n}","3.{n}"' for n in range(specimens)),
    ]
    for n in range(specimens):
        lines += ["", "Results Table 2", "Time,Extension,Load", "(s),(mm),(N)", *_columns("txF", ",", n)]
    return "\r\n".join([*lines, ""])


def side_by_side(short: int = 5) -> str:
    rows = _columns("txF", "\t")
    second = [row if n < len(rows) - short else "\t\t" for n, row in enumerate(rows)]
    names, units = '"Prüfzeit"\t"Standardweg"\t"Standardkraft"', '"s"\t"mm"\t"N"'
    lines = ['"Kunde"\t"film"', "", f"{names}\t{names}", f"{units}\t{units}"]
    return "\r\n".join([*lines, *(f"{a}\t{b}" for a, b in zip(rows, second, strict=True)), ""])


def mts_testsuite(separator: str = ",", quote: str = '"') -> str:
    above = {
        "File Path": "C:\\tests\\film",
        "Test": "Tensile (Simplified)",
        "Test Run": "Test Run 1 3-1-26 10 22 33 AM",
    }
    entries = [f"{quote}{key}: {value}{quote}" for key, value in (above | {"Date": "3/1/2026 10:22:33 AM"}).items()]
    rows = [("Crosshead ", "Load ", "Time "), ("mm", "N", "sec"), *zip(TRAVEL, FORCE, TIME, strict=True)]
    lines = [separator.join(f"{quote}{cell}{quote}" for cell in row) for row in rows]
    return "\r\n".join([*entries, "", *[""] * (separator == ","), *lines, ""])


def nexygen(separator: str = ",") -> str:
    rows = [("Time (s)", "Load (N)", "Machine Extension (mm)"), *zip(TIME, FORCE, TRAVEL, strict=True)]
    return "\r\n".join([*(separator.join(map(str, row)) for row in rows), ""])
