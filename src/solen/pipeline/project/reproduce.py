"""The figures of the paper that software can make, with a page that compares them with the paper's statements."""

import json
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from solen import files
from solen.paper.records import Drawing, Record, chosen, read_record, record_text
from solen.paper.reproduction import ReproducedFigure, Reproduction
from solen.pipeline.options import ProgressBar
from solen.pipeline.outputs import figure_bytes
from solen.pipeline.project.paper.model import PaperFigure, Picture
from solen.progress import part_of
from solen.results import Outcome

DPI = 160
PAGE = "reproduction.html"
Figures = Annotated[tuple[str, ...], Parameter(name="--figure")]


def reproduce(*, out: Path, figures: Figures = (), progress: ProgressBar = None) -> Outcome[Reproduction]:
    """Make the paper's figures from what ships with solen, and compare its numbers with solen's.

    Data that the paper does not publish are simulated and marked as such. A finished figure is not made again unless
    solen or its files have changed, so an interrupted run continues.

    Parameters
    ----------
    out
        Folder for reproduction.html, reproduction.json, the figures and the simulated data; created if missing.
    figures
        Make only this figure (3), letter (3C) or letters (3B-D); repeatable; default: all.

    Raises
    ------
    SolenError
        If the paper has no such figure, or a file cannot be written.
    """
    from solen.pipeline.project.paper import FIGURES
    from solen.report.paper.page import page

    names = chosen([one.name for one in FIGURES], figures)
    with files.output_folder(out), files.output_folder(out / "figures") as drawn, files.output_folder(out / "data"):
        wanted = [one for one in FIGURES if one.name in names]
        made: set[str] = set()
        for place, one in enumerate(wanted):
            if read_record(_record(drawn, one)) is None:
                _make(one, out)
                made.add(one.name)
            if (part := part_of(progress, place, len(wanted))) is not None:
                part(1.0)
        found = [(one, record) for one in FIGURES if (record := read_record(_record(drawn, one))) is not None]
        result = Reproduction(
            figures=tuple(_reproduced(one, record, again=one.name in made) for one, record in found),
            not_made=tuple(one.name for one in FIGURES if one.name not in {other.name for other, _ in found}),
        )
        contents = {PAGE: page(result.figures, result.not_made, drawn), "reproduction.json": _json(result)}
        files.write_all({out / name: text.encode() for name, text in contents.items()})
    return Outcome(result, {"page": out / PAGE})


def _make(one: PaperFigure, out: Path) -> None:
    """Make a figure: write its drawings and, last, its record."""
    drawn, made = out / "figures", one.make(out / "data")
    contents = {picture.file: _drawn(picture) for picture in made.pictures}
    drawings = [Drawing(file=picture.file, alt=picture.alt, mark=picture.mark) for picture in made.pictures]
    texts = contents | {_record(drawn, one).name: record_text(drawings, made.comparisons, contents)}
    files.write_all({drawn / name: content for name, content in texts.items()})


def _drawn(picture: Picture) -> bytes:
    from solen.report.paper.figures import marked

    path, look = Path(picture.file), picture.look.model_copy(update={"dpi": DPI})
    return figure_bytes(lambda: marked(picture.draw(), picture.mark), path, path.stem, look)


def _record(folder: Path, one: PaperFigure) -> Path:
    return folder / f"{one.name}.json"


def _reproduced(one: PaperFigure, record: Record, *, again: bool) -> ReproducedFigure:
    return ReproducedFigure(one.name, one.title, one.commands, record.drawings, record.compared, again)


def _json(result: Reproduction) -> str:
    return json.dumps(result.to_dict(), indent=1, allow_nan=False, ensure_ascii=False) + "\n"
