"""The figures of the paper that can be computed, and a page that compares the paper's values with those of solen."""

import json
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from solen import files
from solen.paper.records import Drawing, read_record, record_text, select_figures
from solen.paper.reproduction import ReproducedFigure, Reproduction
from solen.pipeline.options import ProgressBar
from solen.pipeline.outputs import figure_bytes
from solen.pipeline.project.paper.model import PaperFigure, Picture
from solen.progress import tracked
from solen.results import Outcome

DPI = 160
PAGE = "reproduction.html"
Figures = Annotated[tuple[str, ...], Parameter(name="--figure")]


def reproduce(*, out: Path, figures: Figures = (), progress: ProgressBar = None) -> Outcome[Reproduction]:
    """Reproduce the figures of the paper, and compare its values with those computed by solen.

    Data that the paper does not publish are simulated and marked as such. A finished figure is kept unless solen or the
    files of the figure have changed, so an interrupted run can be continued.

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

    names = select_figures([figure.name for figure in FIGURES], figures)
    with files.output_folder(out), files.output_folder(out / "figures") as folder, files.output_folder(out / "data"):
        requested = [figure for figure in FIGURES if figure.name in names]
        made: set[str] = set()
        for figure in tracked(requested, progress):
            if read_record(_record(folder, figure)) is None:
                _make(figure, out)
                made.add(figure.name)
        records = {figure.name: read_record(_record(folder, figure)) for figure in FIGURES}
        result = Reproduction(
            figures=tuple(
                ReproducedFigure(
                    figure.name,
                    figure.title,
                    figure.commands,
                    record.drawings,
                    record.compared,
                    figure.name in made,
                )
                for figure in FIGURES
                if (record := records[figure.name]) is not None
            ),
            not_made=tuple(name for name, record in records.items() if record is None),
        )
        contents = {PAGE: page(result.figures, result.not_made, folder), "reproduction.json": _json(result)}
        files.write_all({out / name: text.encode() for name, text in contents.items()})
    return Outcome(result, {"page": out / PAGE})


def _make(figure: PaperFigure, out: Path) -> None:
    """Make a figure: write its drawings and, last, its record."""
    folder, made = out / "figures", figure.make(out / "data")
    contents = {picture.file: _image(picture) for picture in made.pictures}
    drawings = [Drawing(file=picture.file, alt=picture.alt, mark=picture.mark) for picture in made.pictures]
    outputs = contents | {_record(folder, figure).name: record_text(drawings, made.comparisons, contents)}
    files.write_all({folder / name: content for name, content in outputs.items()})


def _image(picture: Picture) -> bytes:
    from solen.report.paper.figures import marked

    path, options = Path(picture.file), picture.options.model_copy(update={"dpi": DPI})
    return figure_bytes(lambda: marked(picture.draw(), picture.mark), path, path.stem, options)


def _record(folder: Path, figure: PaperFigure) -> Path:
    return folder / f"{figure.name}.json"


def _json(result: Reproduction) -> str:
    return json.dumps(result.to_dict(), indent=1, allow_nan=False, ensure_ascii=False) + "\n"
