"""Parallel compilation of the tracer by several processes, on the first use after an installation.

`solen run` uses three parts of the tracer of about the same size: integration in space for the design itself,
integration in the plane for the comparison with the paper, and sampled rays through a lens for skew rays. In one
process, numba compiles the functions one after another and stores each on disk. Two more processes therefore compile
the latter two parts by tracing a small example of each, while the command starts with the first. A process that needs a
function later reads the compiled function from disk.
"""

import subprocess
import sys

from solen.trace.kernel.compiled import cache_folder

PARTS: dict[str, tuple[str, dict[str, str]]] = {
    "adapt.integrate_cone": ("paper-860", {}),
    "extruded.trace_in_space": ("solen-860", {"lens.shape": "layered"}),
}
"""Template, and values to set in it, of a design whose trace uses a part, keyed by a function in that part."""
PROGRAM = """
from solen.sensor import Sensor
from solen.spec import loads, template, with_values
Sensor.of(with_values(loads(template({name!r})), {values!r})).power((0.0,), tolerance=1e-2)
"""

_STARTED: list[subprocess.Popen[bytes]] = []  # kept: Python warns of a running process whose object is deleted


def parts_to_compile() -> list[str]:
    """Return Python programs that compile the parts not yet on disk; none if there is no cache folder."""
    folder = cache_folder()
    if folder is None:
        return []
    return [
        PROGRAM.format(name=name, values=values)
        for function, (name, values) in PARTS.items()
        if not any(folder.glob(f"{function}-*.nbc"))
    ]


def precompile() -> None:
    """Start the compilation in separate processes, which end automatically, and return without waiting."""
    for program in parts_to_compile():
        devnull = subprocess.DEVNULL
        command = [sys.executable, "-c", program]
        process = subprocess.Popen(command, stdin=devnull, stdout=devnull, stderr=devnull)  # noqa: S603  a fixed program
        _STARTED.append(process)
