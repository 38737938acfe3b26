"""The tracer compiled by several processes at once, on the first use after an installation.

What `solen run` needs falls into three parts of about the same size: the integration in space that the design itself is
traced with, the integration in the plane for the comparison with the paper, and sampled rays through a lens for space.
numba compiles one function at a time in a process, and keeps each on disk; so two more processes trace a small case of
the other two parts, while the command begins with its own. Whoever comes second reads what the first has left.
"""

import subprocess
import sys

from solen.trace.kernel.compiled import cache_folder

PARTS: dict[str, tuple[str, dict[str, str]]] = {
    "adapt.integrate_cone": ("paper-860", {}),
    "extruded.trace_in_space": ("solen-860", {"lens.shape": "layered"}),
}
"""A function of each part, and a design that is traced with it: template and values."""
PROGRAM = """
from solen.sensor import Sensor
from solen.spec import loads, template, with_values
Sensor.of(with_values(loads(template({name!r})), {values!r})).power((0.0,), tolerance=1e-2)
"""


def parts_to_compile() -> list[str]:
    """Programs that compile the parts of which nothing is kept yet; none where nothing can be kept."""
    folder = cache_folder()
    if folder is None:
        return []
    return [
        PROGRAM.format(name=name, values=values)
        for function, (name, values) in PARTS.items()
        if not any(folder.glob(f"{function}-*.nbc"))
    ]


def compile_ahead() -> None:
    """Begin to compile in processes of their own, which end by themselves; nothing is waited for."""
    for program in parts_to_compile():
        nowhere = subprocess.DEVNULL
        command = [sys.executable, "-c", program]
        subprocess.Popen(command, stdin=nowhere, stdout=nowhere, stderr=nowhere)  # noqa: S603  our own text
