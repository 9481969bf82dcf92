"""The command `convert`: camera and pose files of one program for another."""

import json
import os
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from rastercov.base import ConfigError, plural
from rastercov.cli import options
from rastercov.cli.console import print_lines, warn
from rastercov.cli.inputs import lines_of_lost_poses
from rastercov.core.camera import Conventions
from rastercov.formats.cameras import READERS, WRITERS, format_of, read_views, write_views


@options.expand_options
def convert(
    source: Annotated[
        Path,
        Argument(
            metavar="IN",
            help="File or folder to read: COLMAP, transforms.json, OpenCV, ROS, Kalibr, "
            "Metashape, OpenSfM, Bundler, BAL, glTF, MVSNet or rastercov.",
        ),
    ],
    target: Annotated[
        Path,
        Argument(
            metavar="OUT",
            help="File to write, in the format of its suffix: .json, .toml (one camera), "
            "transforms.json, .yaml (OpenCV), .glb (frusta), .npy (poses), or a folder (COLMAP).",
        ),
    ],
    conventions: Conventions,
    read_as: Annotated[
        str | None,
        Option(
            "--from",
            help=f"Format of IN: {', '.join(READERS)}.",
            show_default="detected from the content",
        ),
    ] = None,
    write_as: Annotated[
        str | None,
        Option(
            "--to", help=f"Format of OUT: {', '.join(WRITERS)}.", show_default="that of the suffix"
        ),
    ] = None,
    camera_name: options.CameraName = None,
    overwrite: Annotated[bool, Option("--overwrite", help="Overwrite OUT.")] = False,
    as_json: options.AsJson = False,
) -> None:
    """Convert camera and pose files, and report what the target format cannot represent.

    Example: rastercov convert sparse/0 transforms.json

    Inspect a rig: rastercov convert camchain.yaml rig.glb
    """
    views = read_views(source, format=read_as, conventions=conventions)
    if camera_name is not None:
        views = views.of_camera(camera_name)
    if os.path.realpath(source) == os.path.realpath(target):
        raise ConfigError(f"{target}: expected another file than IN, got the same; change its name")
    notes = [*views.notes, *lines_of_lost_poses(views.poses)]
    warn(*(f"{source}: {note}" for note in notes))
    lost = write_views(target, views, format=write_as, overwrite=overwrite)
    warn(*(f"{target}: {note}" for note in lost))
    names = [] if views.rig is None else list(views.rig.names)
    result = {
        "cameras": names,
        "poses": len(views.poses),
        "has_unit": views.has_unit,
        "format": write_as or format_of(target),
        "notes": [*notes, *lost],
        "file": str(target),
    }
    if as_json:
        print(json.dumps(result, indent=2))
    else:
        counts = plural(len(names), "camera"), plural(len(views.poses), "pose")
        held = [each for each in counts if not any(each in note for note in lost)]
        print_lines(f"{', '.join(held)}: {target}")
