"""What a script calls: files in, typed results out, nothing written unless a file is named.

Each function is what the command of that name does. Its options are the fields of the options class that its text
names, given by keyword.
"""

from pathlib import Path
from typing import Any

from solen.material.loss import CutbackOptions, GuideLoss


def cutback(file: Path | str, **options: Any) -> GuideLoss:
    """Loss of a guide in dB/cm from a file of powers at several lengths; `CutbackOptions` lists the options."""
    from solen.pipeline.resin.cutback import cutback as run

    return run(Path(file), CutbackOptions(**options)).result
