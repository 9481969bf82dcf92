"""Results in notebooks: a table with one picture, the whole page in a frame, and tables of figures.

All three show what the pages of the commands show, from the same functions. Notebooks ask a value
for `_repr_html_`, which `base.format.InNotebook` takes from `html_of`.
"""

import math
import sys
import tempfile
import webbrowser
from collections.abc import Callable, Sequence
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from rastercov.base import (
    ByName,
    ConfigError,
    ReadByName,
    StrPath,
    check_choice,
    check_kind,
    percent,
    plural,
    shown,
    write_text,
)
from rastercov.base.format import area
from rastercov.core.camera import names_of
from rastercov.core.coverage.coverage import Coverage
from rastercov.core.coverage.evaluation import Evaluation
from rastercov.core.coverage.network import Network, reasons_of
from rastercov.core.coverage.task import REASONS
from rastercov.core.mesh import Mesh
from rastercov.placement.parts import MOST_ROWS, PartRow, part_rows
from rastercov.placement.plan.check import Checked, to_json
from rastercov.placement.plan.run import Placement
from rastercov.placement.reconstruction import Reconstruction
from rastercov.report import audit, check, coverage, placement
from rastercov.report.coverage_files import INSTALL_PYARROW, has_parquet
from rastercov.report.images import add_frame
from rastercov.report.modes import mode_picture
from rastercov.report.network_page import NetworkPage
from rastercov.report.pages import MOST_OF_REPORT, Picture, describe_mesh, render
from rastercov.report.panorama import neutral, side_by_side, sides
from rastercov.report.plan import lines, summary
from rastercov.report.tables import heading_and_tilt

KINDS = (Evaluation, Placement, Checked, Reconstruction)
Result = Evaluation | Placement | Checked | Reconstruction
Cells = tuple[Sequence[str], Sequence[Sequence[str]]]
"""Headings and rows."""
WORDS = "a result of evaluate, place, check or audit"
MOST_PAIRS = 200_000
"""Pairs of camera and face up to which the area of each camera is measured for a picture: 0.1 s."""
GROUPS = "group role faces area_m2 covered_percent covered_of_seeable_percent"
ZONES = "zone group area_m2 percent x y z reason hidden_by nearest_pose advice"
WEAK = "zone kind area_m2 percent x y z mean_views gsd_per_px angle_deg distance advice"
"""Columns of tables; those of an audit's zones last."""
TYPES = dict.fromkeys(("zone", "faces", "nearest_pose"), "int64")
TYPES |= dict.fromkeys(("group", "role", "reason", "hidden_by", "kind", "advice"), "string")
"""Of columns; other ones are double."""


def network_of(value: Result, most_pairs: float = MOST_PAIRS) -> NetworkPage:
    """Page of a result; up to some pairs of camera and face with the area of each camera."""
    if isinstance(value, Reconstruction):
        return audit.page_of(value, value.summary())
    network = value.network if isinstance(value, Evaluation) else value.cameras.network
    has_parts = len(network.pose_ids) * network.mesh.n_faces <= most_pairs
    if isinstance(value, Evaluation):
        parts = coverage.regions_of(value) if has_parts else None
        return coverage.network_of(value, value.summary(), parts=parts)
    told = to_json(value) if isinstance(value, Checked) else summary(value)
    return placement.network_of(value, told, has_parts=has_parts)


def _draw_mesh(mesh: Mesh) -> Image.Image:
    """Picture of a mesh alone, from two sides."""
    pixels, keys = side_by_side(mesh, neutral(mesh), np.zeros(mesh.n_faces, np.uint8), sides(mesh))
    return add_frame(pixels, "", keys)


def html_of(value: Any) -> str:
    """HTML of a mesh or a result: a heading, lines, a table and a picture."""
    said: list[tuple[str, str | None]] = []
    draw: Callable[[], Image.Image]
    if isinstance(value, Mesh):
        mesh, heading = value, f"Mesh of {plural(value.n_faces, 'face')}, {value.size_in_words}"
        said, table = [(text, None) for text in mesh.warnings], _groups(mesh)
        draw = partial(_draw_mesh, mesh)
    elif isinstance(value, Result):
        page = network_of(value)
        mesh, heading, draw = page.mesh, page.answer, page.overview
        table = _parts(page.figures, page.unit)
        asked = getattr(value, "requirements", ())
        said = placement.verdicts(asked) if asked else []
    else:
        network = value
        if isinstance(value, Coverage):
            network = Network(value.mesh, value.task)
            network.add(value)
        mesh, figures = network.mesh, network.summary()
        share = percent(figures["covered"]["area_percent"] / 100)
        heading = f"{plural(figures['poses'], 'pose', 'cover')} {share} of the area"
        table, draw = _parts(figures), partial(mode_picture, "coverage", mesh, network.best)
    picture = Picture.of(heading, draw()) if mesh.n_faces <= MOST_OF_REPORT else None
    return render("notebook.html", heading=heading, lines=said, table=table, picture=picture)


def _groups(mesh: Mesh) -> Cells:
    m2 = np.bincount(mesh.face_group, mesh.areas, len(mesh.groups)).tolist()
    rows = [
        (each["name"], each["role"], f"{each['faces']:,}", area(own))
        for each, own in zip(describe_mesh(mesh)["groups"], m2, strict=True)
    ]
    return ("group", "role", "faces", "area"), rows


def _parts(figures: ReadByName, unit: str = "m") -> Cells:
    """Parts that are covered least, and all of them where there are several."""
    parts = part_rows(figures)
    every = parts if len(parts) == 1 else [*parts[: MOST_ROWS - 1], PartRow.of(figures)]
    rows = [
        (row.name, area(row.area_m2, unit), percent(row.percent / 100), row.reason) for row in every
    ]
    covered = "covered" if "covered_area" in figures else "faces covered"
    return ("part", "area", covered, "main cause"), rows


class Page:
    """The page of a result, which a notebook shows in a frame; see `show`.

    Attributes
    ----------
    html : str
        Text of the page, which needs no other file.
    height : int
        Height of the frame, CSS pixels.
    path : Path or None
        The file that was written, if any.
    """

    def __init__(self, html: str, height: int, path: Path | None) -> None:
        self.html, self.height, self.path = html, height, path

    def __repr__(self) -> str:
        return f"Page({len(self.html) / 1e6:.1f} MB{f', {self.path}' if self.path else ''})"

    def _repr_html_(self) -> str:
        # The frame may run scripts and save pictures; it cannot reach the notebook.
        return (
            f'<iframe srcdoc="{escape(self.html)}" title="rastercov" width="100%" '
            f'height="{self.height}" frameborder="0" sandbox="allow-scripts allow-downloads">'
            "</iframe>"
        )


def show(
    value: Result,
    path: StrPath | None = None,
    *,
    height: int = 700,
    open_browser: bool = False,
) -> Page:
    """Show the page of a result: inline in a notebook, elsewhere as a file.

    Parameters
    ----------
    value : Evaluation, Placement, Checked or Reconstruction
        Result of `evaluate`, `place`, `check` or `audit`.
    path : path, optional
        HTML file to write; unless given, a temporary file outside of a notebook, and none in a
        notebook. The name of the file is printed.
    height : int
        Height of the frame in a notebook, CSS pixels.
    open_browser : bool
        Open the file in a browser.

    Returns
    -------
    Page
        `html`, the text of the page, and `path`, the file or None.

    Raises
    ------
    ConfigError
        For another value, a name that does not end in .html, and an invalid height.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(64, 48, hfov_deg=60)
    >>> result = rc.evaluate(mesh, camera, rc.look_at((0.6, 0, 0), (0, 0, 0)))
    >>> page = rc.show(result, "page.html")
    wrote page.html
    >>> page.path.exists()
    True
    """
    check_kind("value", value, KINDS, WORDS, ConfigError)
    if path is not None and not str(path).lower().endswith(".html"):
        raise ConfigError(f"expected a path that ends in .html, got {shown(str(path))}; rename it")
    if not height >= 1:
        raise ConfigError(f"expected a height of 1 pixel or more, got {height}; correct it")
    html, file = _page_of(value), None if path is None else Path(path)
    if file is None and (open_browser or not _is_notebook()):
        file = Path(tempfile.mkdtemp(prefix="rastercov_"), "page.html")
    if file is not None:
        write_text(file, html)
        print(f"wrote {file}")
        if open_browser:
            webbrowser.open(file.resolve().as_uri())
    return Page(html, height, file)


def _is_notebook() -> bool:
    """True in a kernel of Jupyter, which shows what a cell returns."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return getattr(shell, "kernel", None) is not None


def _page_of(value: Result) -> str:
    if isinstance(value, Evaluation):
        return coverage.html_of(value)
    if isinstance(value, Checked):
        return check.html_of(value)
    if isinstance(value, Reconstruction):
        return audit.html_of(value)
    told, log = summary(value), lines(value, named=())
    return placement.pages_of(value, told, log, lambda *done: None, has_view=None)["page.html"]


def table(value: Result, name: str) -> Any:
    """Values of a result as a `pyarrow.Table`; its `to_pandas()` is a data frame.

    Parameters
    ----------
    value : Evaluation, Placement, Checked or Reconstruction
        Result of `evaluate`, `place`, `check` or `audit`.
    name : {"faces", "cameras", "zones", "groups"}
        One row for each evaluated face (for an audit by area, each patch), each camera or image,
        each dead zone (for an audit, each weak zone), or each group of faces. Lengths are in
        metres, areas in m^2.

    Raises
    ------
    ConfigError
        For another value or name, and if pyarrow is not installed.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(64, 48, hfov_deg=60)
    >>> result = rc.evaluate(mesh, camera, rc.look_at((0.6, 0, 0), (0, 0, 0)))
    >>> rows = rc.table(result, "faces").to_pydict()
    >>> rows["covered"].count(True), rows["reason"][0]
    (2, 'back_facing')
    """
    check_kind("value", value, KINDS, WORDS, ConfigError)
    check_choice("name", name, ("faces", "cameras", "zones", "groups"))
    if not has_parquet():
        raise ConfigError(f"expected pyarrow for tables, got no package; run: {INSTALL_PYARROW}")
    import pyarrow as pa

    page = network_of(value, math.inf if name == "cameras" else 0)
    tables: dict[str, Callable[[], Any]] = {
        "faces": lambda: pa.table(_faces(page)),
        "cameras": lambda: pa.table(_cameras(page)),
        "zones": lambda: _frame_of_entries(page.dead[1]["dead_zones"], ZONES),
        "groups": lambda: _frame_of_entries(page.figures["groups"], GROUPS),
    }
    if isinstance(page, audit.AuditPage):
        tables["faces"] = lambda: pa.table(audit.arrays_of(page.found))
        tables["cameras"] = lambda: pa.table(audit.cameras_of_images(page.found, page.summary))
        tables["zones"] = lambda: _frame_of_entries(page.summary["weak"]["zones"], WEAK)
    return tables[name]()


def _frame_of_entries(entries: Sequence[ReadByName], columns: str) -> Any:
    """Table of the entries of zones or groups of a summary."""
    rows = []
    for number, each in enumerate(entries, 1):
        whole, nearest = each.get("covered", {}), each.get("nearest") or {}
        exact = each.get("covered_area", {"percent": whole.get("area_percent")})
        row = {"zone": number, "area_m2": each.get("m2"), "covered_percent": exact["percent"]}
        group = each.get("groups", (each.get("name"),))[0]
        row |= {"group": group, "nearest_pose": nearest.get("pose")}
        rows.append(row | dict(each) | dict(zip("xyz", each.get("centroid", ()), strict=False)))
    import pyarrow as pa

    schema = pa.schema([(name, TYPES.get(name, "double")) for name in columns.split()])
    return pa.Table.from_pylist(rows, schema)


def _faces(page: NetworkPage) -> ByName:
    import pyarrow as pa

    from rastercov.report.parquet import group_names

    mesh, network, faces = page.mesh, page.network, np.flatnonzero(page.mesh.task_mask)
    why = reasons_of(network, page.covered)[faces].astype(np.int32)
    columns = {
        "area_m2": mesh.areas,
        "covered": page.covered,
        "views": network.views,
        "best_coverage": network.best,
        "best_pose": network.best_pose,
    }
    if page.areas is not None:
        is_covered = page.areas.covered
        columns["covered_m2"] = is_covered.area[page.need - 1, np.arange(mesh.n_faces)]
        columns["bound_m2"] = is_covered.bound
    columns = {name: values[faces] for name, values in columns.items()}
    reasons = pa.DictionaryArray.from_arrays(why, pa.array(REASONS))
    return {"face": faces, "group": group_names(mesh, faces), "reason": reasons} | columns


def _cameras(page: NetworkPage) -> ByName:
    types, poses = names_of(page.camera), page.poses.world_from_camera
    turned = np.array([heading_and_tilt(pose) for pose in poses]).reshape(-1, 2).T
    columns: ByName = {page.noun: page.poses.ids}
    if len(types) > 1:
        columns["type"] = [types[row] for row in page.poses.camera]
    columns |= zip(("x", "y", "z", "heading_deg", "down_deg"), [*page.eyes.T, *turned], strict=True)
    columns["covered_faces"] = page.covered_faces
    more = {"covered_m2": page.seen_m2, "only_by_it_m2": page.lost_m2}
    return columns | {name: each for name, each in more.items() if each is not None}
