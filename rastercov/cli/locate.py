"""The command `locate`: poses of installed cameras from photographs, and what they cover now."""

from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from rastercov.base import ConfigError
from rastercov.base.output import json_text
from rastercov.cli.console import out_option, print_lines, say, warn
from rastercov.cli.inputs import read_rig
from rastercov.cli.options import AsJson, CameraOptions, Pdf, expand_options
from rastercov.cli.place import PlanFile
from rastercov.core.camera import Conventions, names_of_poses


@expand_options
def locate(
    photo: Annotated[
        Path,
        Argument(metavar="PHOTO", help="Photograph, or a folder of them with names of cameras."),
    ],
    plan: PlanFile,
    poses: Annotated[
        str, Option("--poses", "-p", help="Pose file of the rig as planned, such as poses.json.")
    ],
    conventions: Conventions,
    camera: CameraOptions,
    of: Annotated[
        str | None,
        Option(help="Name of the camera of PHOTO, or its number from 1.", show_default="the only"),
    ] = None,
    points: Annotated[
        Path | None,
        Option(
            help="CSV file of pixels and points: columns u, v (px from the top-left corner), x, y, "
            "z (m).",
            show_default="edges of the model are used",
        ),
    ] = None,
    pixel_error: Annotated[
        float, Option(min=0.01, help="Standard deviation of the pixels of --points, px.")
    ] = 1.0,
    rigid: Annotated[
        bool, Option("--rigid", help="The cameras moved as one; those undecided follow.")
    ] = False,
    within: Annotated[
        str | None,
        Option(
            help='Accepted deviation, such as "10 mm, 0.5 deg".',
            show_default="that of the plan; 1 % of the distance and 1 deg without one",
        ),
    ] = None,
    out: Annotated[
        Path | None, out_option("Output folder for a page (locate.html) and the rig as built.")
    ] = None,
    junit: Annotated[
        Path | None,
        Option(help="Write JUnit XML: one test per photograph, requirement and dead zone."),
    ] = None,
    pdf: Pdf = False,
    as_json: AsJson = False,
) -> None:
    """Find the pose of an installed camera from a photograph, and what it covers now.

    Exit code 0: as planned; 1: moved; 2: undecided.

    Example: rastercov locate photo.jpg plan.toml --poses rig.json --of 3 --out built/
    """
    from rastercov.asbuilt.located import read_points
    from rastercov.asbuilt.rig import AsBuilt, locate_rig, match_photographs, tolerance_of
    from rastercov.placement.plan import check as plan_check
    from rastercov.placement.plan import outcome
    from rastercov.placement.plan.file import read_plan

    if pdf and out is None:
        raise ConfigError("--pdf: expected a folder for the page, got none; name it with --out")
    outcome.refuse_other(junit, None)
    asked = read_plan(plan)
    accepted = tolerance_of(asked, within)
    eyes = read_rig(camera, Path(poses), conventions)
    asked = asked.without_cameras() if camera.camera and eyes.rig is not None else asked
    limits = plan_check.limits(asked, None, {}, may_be_none=True)
    photos = match_photographs(photo, names_of_poses(eyes.poses, eyes.images), of)
    pairs = None if points is None else read_points(points)

    def made() -> AsBuilt:
        planned = plan_check.check(asked, Path(poses), limits, poses=eyes)
        given = planned, photos, pairs, accepted, pixel_error
        return locate_rig(*given, is_rigid=rigid, is_all=photo.is_dir())

    if out is None:
        result = made()
    else:
        from rastercov.asbuilt.report import write  # with the first page only

        result = write(made, out, pdf=pdf)
    outcome.write(junit, None, plan, result.cases())
    warn(*eyes.notes)
    if as_json:
        print(json_text(result.to_json()))
    else:
        print_lines(*result.lines())
        if out is not None:
            say(str(out / "locate.html"))
    if result.status:
        raise typer.Exit(result.status)
