"""Tables and files of a run: Parquet of every pair, JSON, a coloured mesh, tables to print.

Last link of the chain, beside `pictures`: from `Coverage` and `Network` to what a person or a
program opens. A file appears under its name only when it is whole: it is written beside its place
and then renamed. What a disk refuses is an `OSError` that names the file. `report_folder` does the
same for all files of a report together.
"""

import dataclasses
import json
import math
import os
import secrets
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, Self

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import trimesh
from numpy.typing import ArrayLike, NDArray
from PIL import Image
from rich.table import Table
from rich.text import Text

from rastercov.coverage import FIGURES, Coverage, Reason
from rastercov.errors import ConfigError
from rastercov.mesh import Mesh
from rastercov.observer import Kind
from rastercov.report.folder import named

CODES = {"visibility_kind": Kind, "reason": Reason}
"""Figures that are written by name."""
ROWS_A_GROUP = 1 << 18
"""Rows of a Parquet row group: about 13 MB of columns."""
UNITS = {
    "projected_area": "px^2",
    "visible_pixels": "px",
    "drawn_pixels": "px",
    "pixel_density": "px/m",
    "incidence": "rad",
}
CONTROL_POINTS = ((62, 18, 96), (57, 82, 140), (32, 144, 140), (116, 203, 83), (253, 231, 37))
"""Dark violet over teal to yellow, sRGB: lightness rises evenly, so that it reads in grey too."""
UNSEEN, HIDING = (232, 33, 45), (146, 160, 178)
PALETTE = 256


class CoverageTable:
    """Parquet file of every pose-face pair in view, written as the batches come.

    A pair is in view when any part of the face is inside the image (`in_view_fraction` > 0); faces
    seen from behind are among them. Columns: `pose` and `face` (int32), `group` (its name,
    dictionary-encoded: a category in pandas and polars), then `coverage.FIGURES`, floats as
    float32, `incidence` in radians, `reason` and `visibility_kind` by name in lower case,
    dictionary-encoded.
    `visibility_bound` takes in what float32 rounds off `visibility`, so that it still holds.

    Parameters
    ----------
    path : path
        Where the file appears when the `with` block ends well; otherwise nothing changes there.
    header : mapping, optional
        About the run (inputs and their hashes, settings, device), kept as JSON under the key
        "rastercov" of the schema's metadata.

    Notes
    -----
    Memory does not grow with the run: at most `ROWS_A_GROUP` rows and one batch are held. A run
    without a pair in view gives a valid file without rows.

    One thread at a time may use a table: measure in several, add rows in one.
    """

    def __init__(self, path: str | Path, header: Mapping[str, Any] | None = None) -> None:
        self.path = Path(path)
        names = pa.dictionary(pa.int32(), pa.string())
        kinds = {"pose": pa.int32(), "face": pa.int32(), "group": names}
        for name, kind in FIGURES.items():
            kinds[name] = pa.bool_() if kind is np.bool_ else pa.float32()
        kinds |= dict.fromkeys(CODES, names)
        fields = [
            pa.field(name, kind, False, {"unit": UNITS[name]} if name in UNITS else None)
            for name, kind in kinds.items()
        ]
        self.schema = pa.schema(fields, {"rastercov": _json(header or {}, indent=None)})
        self.n_rows = 0
        self._writer: Any = None
        self._pending: Any = None
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack, named(self.path):
            part = stack.enter_context(replacing(self.path))
            # Opened by us, because pyarrow takes only paths that are UTF-8.
            file = stack.enter_context(part.open("wb"))
            # Dictionaries suit columns with few values; the others are split into their bytes,
            # which compress better side by side.
            spread = ["projected_area", "visible_pixels", "drawn_pixels", "resolution"]
            spread += ["pixel_density", "incidence"]
            self._writer = stack.enter_context(
                pq.ParquetWriter(
                    file,
                    self.schema,
                    compression="zstd",
                    use_dictionary=[n for n in self.schema.names if n not in (*spread, "face")],
                    use_byte_stream_split=spread,
                    column_encoding={"face": "DELTA_BINARY_PACKED"},
                )
            )
            self._pending = self.schema.empty_table()
            self._stack = stack.pop_all()
        return self

    def add(self, coverage: Coverage) -> None:
        """Append the pairs in view of the next poses."""
        if self._writer is None:
            raise ConfigError("a table takes rows inside its with block only; open it there")
        mesh = coverage.mesh
        pairs = np.flatnonzero(coverage.in_view_fraction > 0)
        pose, face = np.divmod(pairs, mesh.n_faces)
        columns: dict[str, Any] = {
            "pose": coverage.pose_ids[pose].astype(np.int32),
            "face": face.astype(np.int32),
            "group": _category(mesh.face_group[face], [group.name for group in mesh.groups]),
        }
        with np.errstate(over="ignore"):  # what float32 cannot hold becomes inf
            for name, kind in FIGURES.items():
                values = getattr(coverage, name).ravel()[pairs]
                columns[name] = values if kind is np.bool_ else values.astype(np.float32)
        for name, codes in CODES.items():
            columns[name] = _category(columns[name], [code.name.lower() for code in codes])
        exact = coverage.visibility.ravel()[pairs]
        bound = coverage.visibility_bound.ravel()[pairs] + np.abs(columns["visibility"] - exact)
        short = bound.astype(np.float32)
        columns["visibility_bound"] = np.where(
            short < bound, np.nextafter(short, np.float32(np.inf)), short
        )
        rows = pa.table(columns, schema=self.schema)
        self.n_rows += len(rows)
        pending = pa.concat_tables([self._pending, rows])
        whole = len(pending) // ROWS_A_GROUP * ROWS_A_GROUP
        # What stays is set aside first: an interrupt comes after the writing, and must not leave
        # rows to be written twice. The copy lets go of the batch.
        rest = pending.slice(whole)
        self._pending = rest.take(np.arange(len(rest))) if whole else rest
        if whole:
            with named(self.path):
                self._writer.write_table(pending.slice(0, whole), row_group_size=ROWS_A_GROUP)

    def __exit__(self, *error: Any) -> None:
        if error[0] is None:
            with named(self.path), self._stack:
                if len(self._pending):
                    self._writer.write_table(self._pending)
        else:
            with suppress(OSError):  # of a disk that is full, which is what ended the block
                self._stack.__exit__(*error)
        self._writer = self._pending = None


def write_json(path: str | Path, data: Any) -> None:
    """Write data as JSON: numpy values as plain ones, numbers that are not finite as null."""
    write_bytes(path, _json(data, indent=2) + b"\n")


def json_text(data: Any) -> str:
    """Text that `write_json` writes, in ASCII, which any terminal or pipe takes."""
    return json.dumps(_plain(data), indent=2, allow_nan=False)


def write_text(path: str | Path, text: str) -> None:
    """Write a page as UTF-8, whatever the names in it hold."""
    write_bytes(path, text.encode("utf-8", errors="backslashreplace"))


def write_bytes(path: str | Path, data: bytes) -> None:
    """Write a file whose content is known."""
    with writing(Path(path)) as part:
        part.write_bytes(data)


def write_npz(path: str | Path, **arrays: NDArray[Any]) -> None:
    """Write arrays by their names as compressed `.npz`."""
    with writing(Path(path)) as part, part.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type] # numpy's own flag is typed


def write_coloured_mesh(path: str | Path, mesh: Mesh, values: ArrayLike) -> None:
    """Write the mesh, each face in the colour of its coverage, for any 3D viewer.

    In colour and not in grey, because a viewer's own light would change a grey. From dark violet
    over teal to yellow for coverage up to 1, red for task faces with none, so that what is unseen
    stands out, and grey-blue for occluders. Faces share no vertices, so that each has one colour.

    Parameters
    ----------
    path : path ending in .glb or .ply
        GLB: a node a group, which a viewer can hide; node matrices turn our z upwards to glTF's y
        and carry the offset, so that a part far from the origin keeps its shape in float32. The
        colours are a small texture, because colours of vertices are linear light in glTF and not
        every viewer shows them. PLY: axes as they are, colours of vertices, one mesh in the order
        of `mesh.faces`, coordinates in float32.
    mesh : Mesh
        F faces.
    values : (F,) array_like
        Coverage, such as `Network.best`; beyond [0, 1] shown as the nearer end.
    """
    path = Path(path)
    formats = {".glb": _coloured_scene, ".ply": _coloured_soup}
    if path.suffix.lower() not in formats:
        raise ConfigError(f"{path}: a coloured mesh is saved as .glb or .ply")
    content = formats[path.suffix.lower()](mesh, colour_rows(mesh, values))
    write_bytes(path, content.export(file_type=path.suffix.lower()[1:]))


def summary_table(summary: Mapping[str, Any], rows: int = 20) -> Table:
    """`Network.summary` for a terminal of 80 columns: groups, the whole task, reasons.

    Groups with the least covered come first, at most `rows` of them. "At zero" are faces whose
    coverage is 0 in every camera.
    """
    poses, views = summary["poses"], summary["required_views"]
    title = f"Covered by {poses} camera{'' if poses == 1 else 's'}"
    table = Table(title=title + (f", {views} a face" if views > 1 else ""), title_justify="left")
    table.add_column("group", no_wrap=True, max_width=19)
    for name in ("faces", "covered %", "by area %", "uncovered", "at zero"):
        table.add_column(name, justify="right", no_wrap=True)
    task = [group for group in summary["groups"] if group["role"] == "task"]
    occluders = [group for group in summary["groups"] if group["role"] != "task"]
    task.sort(key=lambda group: float(group["covered"]["percent"]))
    for group in task[:rows]:
        table.add_row(Text(group["name"]), *_shares(group, group["faces"]))
    if task[rows:]:
        table.add_row(f"... {len(task) - rows} more", style="dim")
    for group in occluders[:rows]:
        table.add_row(Text(group["name"]), str(group["faces"]), "occluder", style="dim")
    if len(task) != 1:
        table.add_section()
        table.add_row("all to be seen", *_shares(summary, summary["task_faces"]), style="bold")
    reasons = summary["not_covered_because"]
    if reasons:
        table.add_section()
        table.add_row("not covered because", style="dim")
    for name in sorted(reasons, key=lambda name: -int(reasons[name]["faces"])):
        table.add_row(f"  {name.replace('_', ' ')}", "", "", "", str(reasons[name]["faces"]))
    return table


def run_table(summary: Mapping[str, Any]) -> Table:
    """What ran, how fast, on what, and what came out; from the summary of `run`."""
    covered = summary["covered"]
    table = Table(show_header=False)
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")
    table.add_row("faces", f"{summary['faces']:,}")
    table.add_row("poses", f"{summary['poses']:,}")
    table.add_row("poses per second", f"{summary['poses_per_second']:,.1f}")
    table.add_row("measured by", Text(summary["run"]["measured_by"]["renderer"]))
    table.add_row("visibility", _kinds(summary))
    by_area = f"{covered['area_percent']:.1f} % of the area"
    table.add_row("coverage", f"{covered['percent']:.1f} % of the faces, {by_area}")
    return table


def _kinds(summary: Mapping[str, Any]) -> str:
    """How many figures of visibility are of which kind, and the largest bound."""
    figures = summary["visibility_figures"]
    kinds = ", ".join(f"{n:,} {kind}" for kind, n in figures.items() if n)
    return f"{kinds}; largest bound {summary['largest_visibility_bound']:.2g}" if kinds else "none"


def _shares(entry: Mapping[str, Any], n_faces: int) -> tuple[str, ...]:
    covered = entry["covered"]
    return (
        str(n_faces),
        f"{covered['percent']:.1f}",
        f"{covered['area_percent']:.1f}",
        str(n_faces - covered["faces"]),
        str(entry["zero_in_every_camera"]["faces"]),
    )


def _coloured_soup(mesh: Mesh, entry: NDArray[np.int64]) -> Any:
    """Triangles with colours of vertices, in the order of the faces."""
    colours = np.full((mesh.n_faces, 4), 255, np.uint8)
    colours[:, :3] = coverage_colours()[entry]
    points = mesh.vertices[mesh.faces].reshape(-1, 3)
    corners = np.arange(len(points)).reshape(-1, 3)
    return trimesh.Trimesh(
        points, corners, vertex_colors=np.repeat(colours, 3, axis=0), process=False
    )


def _coloured_scene(mesh: Mesh, entry: NDArray[np.int64]) -> Any:
    """A node a group, turned from z up to y up, with the palette as their texture."""
    looks: Any = trimesh.visual  # its classes are not annotated
    material = looks.material.PBRMaterial(
        name="coverage",
        baseColorTexture=Image.fromarray(coverage_colours()[None]),
        metallicFactor=0.0,
        roughnessFactor=1.0,
        doubleSided=True,
    )
    centre = mesh.bounds.mean(axis=0)
    turn = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], np.float64)
    turn[:3, 3] = turn[:3, :3] @ centre
    root = "root" + "_" * max(len(group.name) for group in mesh.groups)  # no group has this name
    scene = trimesh.Scene(base_frame=root)
    for index, group in enumerate(mesh.groups):
        members = np.flatnonzero(mesh.face_group == index)
        if members.size:
            points = (mesh.vertices[mesh.faces[members]] - centre).reshape(-1, 3)
            corners = np.arange(len(points)).reshape(-1, 3)
            # The middle of a texel, the same for all three corners, whatever the filter.
            u = (np.repeat(entry[members], 3) + 0.5) / PALETTE
            skin = looks.TextureVisuals(np.stack((u, np.full_like(u, 0.5)), axis=1), material)
            part = trimesh.Trimesh(points, corners, visual=skin, process=False)
            scene.add_geometry(part, group.name, group.name, transform=turn)
    return scene


def coverage_colours() -> NDArray[np.uint8]:
    """(256, 3) sRGB: unseen, occluder, and 254 steps of the scale."""
    at = np.linspace(0, 1, len(CONTROL_POINTS))
    steps = np.linspace(0, 1, PALETTE - 2)
    scale = np.stack([np.interp(steps, at, c) for c in np.array(CONTROL_POINTS).T], axis=1)
    palette: NDArray[np.uint8] = np.rint(np.vstack((UNSEEN, HIDING, scale))).astype(np.uint8)
    return palette


def colour_rows(mesh: Mesh, values: ArrayLike) -> NDArray[np.int64]:
    """(F,) row of `coverage_colours` for each face."""
    levels = np.clip(np.nan_to_num(np.asarray(values, np.float64)), 0.0, 1.0)
    if levels.shape != (mesh.n_faces,):
        raise ConfigError(f"values must have shape ({mesh.n_faces},), got {levels.shape}")
    entry = 2 + np.rint(levels * (PALETTE - 3)).astype(np.int64)
    return np.where(mesh.task_mask, np.where(levels > 0, entry, 0), 1)


def _category(indices: NDArray[Any], names: list[str]) -> Any:
    return pa.DictionaryArray.from_arrays(indices.astype(np.int32), pa.array(names, pa.string()))


def _json(data: Any, indent: int | None) -> bytes:
    text = json.dumps(_plain(data), indent=indent, ensure_ascii=False, allow_nan=False)
    # Names of files need not be Unicode; what cannot be encoded becomes \udcXX, valid JSON.
    return text.encode("utf-8", errors="backslashreplace")


def _plain(data: Any) -> Any:
    """The same data in types that JSON has."""
    if isinstance(data, np.ndarray | np.generic):
        data = data.tolist()
    if isinstance(data, float):
        return data if math.isfinite(data) else None
    if isinstance(data, Mapping):
        return {str(key): _plain(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_plain(value) for value in data]
    if dataclasses.is_dataclass(data) and not isinstance(data, type):
        return {f.name: _plain(getattr(data, f.name)) for f in dataclasses.fields(data)}
    return str(data) if isinstance(data, Path) else data


@contextmanager
def writing(path: Path) -> Iterator[Path]:
    """As `replacing`, for a block that only writes: an error of the disk names `path`."""
    with named(path), replacing(path) as part:
        yield part


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Name beside `path` to write to; it takes the place of `path` if the block ends well.

    A link stays, and the file that it leads to is replaced. What is no file, such as a pipe or
    /dev/null, is written to as it is.
    """
    if path.is_dir() or not path.parent.is_dir():
        fault = "is a folder" if path.is_dir() else "its folder does not exist"
        raise ConfigError(f"{path}: {fault}; name a file in an existing folder")
    if path.exists() and not path.is_file():
        yield path
        return
    path = path.resolve()
    part = path.with_name(f".{secrets.token_hex(6)}.part")
    try:
        yield part
        os.replace(part, path)  # noqa: PTH105 - the atomic one by name
    finally:
        part.unlink(missing_ok=True)
