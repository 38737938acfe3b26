"""Parallel compilation of the tracer by several processes, on the first use after an installation.

`solen run` needs three parts of about the same size: the integration in space for the design itself, the integration in
the plane for the comparison with the paper, and sampled rays through a lens for space. In one process, numba compiles
the functions one after another and stores each on disk. Two more processes therefore trace a small example of the other
two parts while the command starts with its own. A process that needs a function later reads the compiled function from
disk.
"""

import subprocess
import sys

from solen.trace.kernel.compiled import cache_folder

PARTS: dict[str, tuple[str, dict[str, str]]] = {
    "adapt.integrate_cone": ("paper-860", {}),
    "extruded.trace_in_space": ("solen-860", {"lens.shape": "layered"}),
}
"""For each part, a function, and the template and values of a design that is traced with it."""
PROGRAM = """
from solen.sensor import Sensor
from solen.spec import loads, template, with_values
Sensor.of(with_values(loads(template({name!r})), {values!r})).power((0.0,), tolerance=1e-2)
"""


def parts_to_compile() -> list[str]:
    """Return programs that compile the parts not yet on disk; empty if nothing can be stored."""
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
        nowhere = subprocess.DEVNULL
        command = [sys.executable, "-c", program]
        subprocess.Popen(command, stdin=nowhere, stdout=nowhere, stderr=nowhere)  # noqa: S603  our own text
