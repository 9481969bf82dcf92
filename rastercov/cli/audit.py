"""The command `audit`: what the images of an existing rig or reconstruction see."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

from typer import Argument, Option

from rastercov.base import ByName, CameraError, ConfigError, PoseError
from rastercov.base.format import area
from rastercov.cli import options
from rastercov.cli.console import print_lines, report_skips, say, warn
from rastercov.cli.inputs import UNIT, SceneOptions, in_metres, lines_of_lost_poses, read_sheet
from rastercov.cli.terminal import print_network, progress_bar
from rastercov.core.camera import Border, Conventions, Views, unit_warnings
from rastercov.core.coverage.task import Task
from rastercov.formats.cameras import read_through
from rastercov.shards import Staff, Tally

if TYPE_CHECKING:
    from rastercov.placement.georeference import GeoReference
    from rastercov.placement.reconstruction import Reconstruction

NO_SCALE = (
    "the reconstruction has no scale, so lengths are in its units; for metres give --pose-unit"
)


class ResultOptions(NamedTuple):
    """Basis of a result, what measures it, and images that are suggested."""

    by: Annotated[
        str | None,
        Option(help="Basis of the result: area or whole faces (face).", show_default="area"),
    ] = None
    resolution_of_result: Annotated[
        float | None,
        Option(
            help="Patch size (longest side), m; smaller is finer.", show_default="from the scene"
        ),
    ] = None
    method: Annotated[str, Option(help="Visibility method: certified, exact or sampled.")] = (
        "certified"
    )
    suggest: Annotated[
        int | None,
        Option(min=1, help="Number of further images to suggest."),
    ] = None


class FootprintOptions(NamedTuple):
    """Files of what each image covers on the plan, and the place of the scene on the Earth."""

    footprints: Annotated[
        Path | None,
        Option(help="Write the footprint of each image: .geojson, .kml, .dxf or .gpkg."),
    ] = None
    overlap_map: Annotated[
        Path | None,
        Option(
            help="Write the number of images that cover each grid cell: .tif (GeoTIFF) or .png."
        ),
    ] = None
    surface: Annotated[
        list[str],
        Option(
            help="Mesh group to project footprints onto, such as the ground. Repeatable.",
            show_default="the surface seen from above",
        ),
    ] = []  # noqa: RUF012 - typer copies it
    map_cell: Annotated[
        float | None,
        Option(help="Side of a grid cell of the map, m.", show_default="1/1000 of the extent"),
    ] = None
    crs: Annotated[
        str | None,
        Option(
            help="Coordinate reference system, such as EPSG:32632.",
            show_default="that of an ODM, OpenSfM or Metashape project",
        ),
    ] = None
    origin: Annotated[
        str | None,
        Option(
            help="Origin of the mesh in the CRS: EASTING,NORTHING[,HEIGHT]; in a geographic CRS "
            "LATITUDE,LONGITUDE[,HEIGHT], with x to the east and y to the north.",
            show_default="0,0,0",
        ),
    ] = None

    def place(self, source: Path) -> "GeoReference | None":
        """Place on the Earth of a camera file, by these options or its project.

        ConfigError for files that could not be written, before the work begins.
        """
        if not self.is_asked:
            for name in ("surface", "map_cell", "crs", "origin"):
                if getattr(self, name):
                    option = f"--{name.replace('_', '-')}"
                    raise ConfigError(
                        f"expected --footprints or --overlap-map with {option}, got none; give one"
                    )
            return None
        from rastercov.placement.georeference import given_reference, reference_of
        from rastercov.survey import geo
        from rastercov.survey.geo import overlap_map

        place = given_reference(self.crs, self.origin) or reference_of(source)
        if self.footprints is not None:
            geo.check(self.footprints, place)
        if self.overlap_map is not None:
            overlap_map.check_name(self.overlap_map)
        if self.map_cell is not None and not self.map_cell > 0:
            raise ConfigError(f"--map-cell: expected metres above 0, got {self.map_cell:g}")
        return place

    @property
    def is_asked(self) -> bool:
        """True where a file is to be written."""
        return self.footprints is not None or self.overlap_map is not None

    def write(self, reconstruction: "Reconstruction") -> None:
        """Write the files of an audit with footprints."""
        if reconstruction.footprints is None:
            return
        from rastercov.survey import geo
        from rastercov.survey.geo import overlap_map
        from rastercov.survey.geo.layer import Layer

        layer = Layer(reconstruction.footprints, reconstruction.place)
        units = "" if reconstruction.unit == "m" else ", in units of the reconstruction"
        say(f"coordinates: {layer.words}{units}")
        if self.footprints is not None:
            geo.write(layer, self.footprints)
        if self.overlap_map is not None:
            counted = overlap_map.overlap_map(layer, self.map_cell)
            overlap_map.write(counted, reconstruction.place, self.overlap_map)


@options.expand_options
def audit(
    source: Annotated[
        Path,
        Argument(
            metavar="CAMERAS",
            help="Cameras and poses: COLMAP folder, transforms.json, Metashape XML or others.",
        ),
    ],
    meshes: options.Meshes,
    scene: SceneOptions,
    conventions: Conventions,
    task: Task,
    processes: options.ProcessOptions,
    result: ResultOptions,
    files: FootprintOptions,
    out: options.Out = Path("audit"),
    level: options.Level = None,
    sheet: options.Sheet = None,
    pdf: options.Pdf = False,
    as_json: options.AsJson = False,
) -> None:
    """Audit existing cameras: what each sees, what is lost without it, and which subset suffices.

    Surface is weak where fewer than --views images (fewer than 2 if --views is 1) see it, where no
    two of its views are --min-angle-deg (5 if not given) apart, or where its sampling distance is
    over twice the median.

    Example: rastercov audit sparse/0 mesh.ply --pose-unit 1 -o audit/

    Footprints: rastercov audit opensfm/ mesh.ply --footprints images.geojson --overlap-map map.tif
    """
    from rastercov.base import json_text
    from rastercov.core.coverage.shards import is_long
    from rastercov.placement.reconstruction import reconstruction
    from rastercov.report.audit import write  # loads pyarrow

    title, place = read_sheet(sheet), files.place(source)
    workers, tally, mesh = processes.open(), Tally(), scene.read(meshes)
    if place is not None:
        place.check_scene(mesh.bounds)
    border = Border(conventions)
    views = _read(source, border, conventions.pose_unit is not None or scene.unit != UNIT)
    assert views.rig is not None
    notes = [
        *views.notes,
        *lines_of_lost_poses(views.poses),
        *([] if views.has_unit else [NO_SCALE]),
    ]
    warn(
        *mesh.warnings, *notes, *border.unused_keys(), *unit_warnings(mesh, views.rig, views.poses)
    )
    with progress_bar(then="report") as progress:
        asked: ByName = result._asdict()
        made = partial(
            reconstruction,
            *(mesh, views.rig, views.poses, task),
            names=views.images or None,
            frames=views.frames,
            staff=Staff(workers, progress, tally.add, warn),
            unit="m" if views.has_unit else "unit",
            suggested=asked.pop("suggest"),
            surface=files.surface if files.is_asked else None,
            place=place,
            **asked,
        )
        is_kept = workers is not None or is_long(len(views.poses), mesh.n_faces)
        kept = asked | {"scene": scene.entries(out, meshes)} | ({"sheet": title} if title else {})
        answer, summary = write(
            made, out, kept, notes, is_kept=is_kept, pdf=pdf, level=level, progress=progress
        )
    files.write(answer)
    if as_json:
        print(json_text(summary))
    else:
        _print(summary, out, level, answer.unit, tally)
    report_skips(summary["quarantined"], is_accepted=conventions.skip_bad_poses)


def _read(source: Path, border: Border, is_metric: bool) -> Views:
    """Cameras with poses of a file, in metres if asked; an error for one without either."""
    views = read_through(source, border)
    if views.rig is None:
        raise CameraError(
            f"{source}: expected poses and cameras, got only poses; give a file with both"
        )
    if not len(views.poses):
        raise PoseError(f"{source}: expected cameras with poses, got no poses; add them")
    if is_metric and not views.has_unit:
        in_metres(views, source)
    return views


def _print(summary: ByName, out: Path, level: int | None, unit: str, tally: Tally) -> None:
    """Print the answer and what is said of it."""
    import numpy as np

    from rastercov.advice.headline import advice_line
    from rastercov.core.area.remedies import round_point
    from rastercov.placement.reconstruction import KINDS
    from rastercov.report.modes import WEAK_LABELS

    weak = [text for text in summary["sentences"] if " of the area is weak" in text]
    lines = [summary["answer"], *weak]
    for zone in summary["weak"]["zones"][:1]:
        at = round_point(np.array(zone["centroid"]), zone["m2"] ** 0.5)[1].removesuffix("m")
        at += "m" if unit == "m" else "units"
        lines.append(
            f"weak zone {area(zone['m2'], unit)} around {at}: "
            f"{WEAK_LABELS[KINDS.index(zone['kind'])]}"
        )
        lines.append(advice_line(zone))
    others = [text for text in summary["sentences"] if text not in weak]
    print_lines(*lines, out / "audit.html", *others)
    if level is not None:
        print_network(summary["network"] | {"noun": "image"}, level, unit=unit)
    for line in tally.lines():
        say(line)
