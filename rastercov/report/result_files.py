"""Files of an evaluation that hold its result as data: one entry each.

From an entry of `FILES` follow the file in the report, its word of `--output` with the help, and
the names that a new report replaces. Pages and pictures are in `coverage`. Writers import what they
need when they write: the help of the command line needs none of it.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from rastercov.base import ConfigError, check_choice

if TYPE_CHECKING:
    from rastercov.core.coverage.evaluation import Evaluation


Writer = Callable[[Path, "Evaluation", Sequence[str]], None]
"""Writes an evaluation to a path, with the names of the images of its poses."""


class ResultFile(NamedTuple):
    """A file of results.

    Attributes
    ----------
    name : str
        In the folder of the report; its stem is the word of `--output`.
    content : str
        Words on it, in the help.
    write : Writer
    is_by_area : bool
        True for a file that only results by area have.
    is_table : bool
        True for a table, which needs pyarrow, and is usual with `--table` only.
    is_usual : bool
        False for a file that is written only where `--output` names it.
    """

    name: str
    content: str
    write: Writer
    is_by_area: bool = False
    is_table: bool = False
    is_usual: bool = True

    @property
    def word(self) -> str:
        """Word of `--output`."""
        return Path(self.name).stem


def _write_areas(path: Path, own: "Evaluation", names: Sequence[str]) -> None:
    from rastercov.report.parquet import write_areas

    assert own.areas is not None
    write_areas(path, own.mesh, own.areas.covered, own.per_camera.of_faces)


def _write_mesh(path: Path, own: "Evaluation", names: Sequence[str]) -> None:
    from rastercov.core.camera import equipment_on
    from rastercov.report.coverage_files import write_coloured_mesh, write_covered_mesh
    from rastercov.report.feature import part_of

    if own.areas is None:
        write_coloured_mesh(path, own.mesh, own.network.best)
        return
    part = part_of(own.areas)
    additions = list(part.additions()) if part else []
    additions += [each._to_gltf for each in equipment_on(own.camera).values()]
    write_covered_mesh(path, own.areas.covered, additions)


def _write_rig(path: Path, own: "Evaluation", names: Sequence[str]) -> None:
    from rastercov.report.coverage_files import write_rig

    write_rig(path, own.camera, own.poses, names)


def _write_features(path: Path, own: "Evaluation", names: Sequence[str]) -> None:
    from rastercov.base import write_text
    from rastercov.report.feature_table import csv_of, feature_rows

    scene = own.mesh, own.camera, own.poses, own.task
    write_text(path, csv_of(feature_rows(*scene, names, own.summary())))


FILES = (
    ResultFile("areas.parquet", "area of each face", _write_areas, is_by_area=True, is_table=True),
    ResultFile("features.csv", "best camera of each group", _write_features, is_usual=False),
    ResultFile("network.glb", "the coloured mesh", _write_mesh),
    ResultFile("rig.json", "cameras and poses", _write_rig),
)
OUTPUT_HELP = "Result files to write instead of the usual ones; repeatable: " + ", ".join(
    f"{each.word} ({each.content})" for each in FILES
)
"""Help of `--output`."""


def files_of(words: Sequence[str], *, by_area: bool, has_tables: bool) -> list[ResultFile]:
    """Files that `words` name, or the usual ones without words.

    ConfigError for a word of none, and for one that only results by area have.
    """
    for word in words:
        check_choice("output", word, [each.word for each in FILES])
    named = [each for each in FILES if each.word in words]
    for each in named:
        if each.is_by_area and not by_area:
            raise ConfigError(
                f"--output {each.word}: expected a result by area, got one by face; leave it out"
            )
    return named or [
        each
        for each in FILES
        if each.is_usual and (by_area or not each.is_by_area) and (has_tables or not each.is_table)
    ]
