"""COLMAP models written: cameras, images and an empty list of points, as text or binary.

Images carry their own poses, which every version of COLMAP reads. Rigs and frames are written where
the views have frames; else COLMAP makes a rig of each camera.
"""

import struct
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

from rastercov.base.errors import ConfigError
from rastercov.base.files import printable
from rastercov.base.output import writing
from rastercov.camera.formats import colmap_rigs
from rastercov.camera.formats.colmap_models import IDS, colmap_of
from rastercov.camera.formats.conventions import unique
from rastercov.camera.formats.rotations import to_quaternions
from rastercov.camera.pose import inverse
from rastercov.camera.views import Views

FILES = ("cameras", "images", "points3D", "rigs", "frames")


def contents_of(views: Views, *, as_text: bool, notes: list[str]) -> dict[str, bytes]:
    """Bytes of each file of a model, by name; what is lost is added to `notes`."""
    rig = views.rig
    assert rig is not None
    found = [colmap_of(camera, name) for camera, name in zip(rig.cameras, rig.names, strict=True)]
    motions = inverse(views.poses.world_from_camera)
    quaternions = to_quaternions(motions[:, :3, :3])
    images = unique([printable(name).replace("\0", "") for name in views.images], "image")
    if images != list(views.images):
        notes.append("names of images are made different from one another")
    index = views.poses.camera.tolist()
    rigs = colmap_rigs.rigs_of(views, notes)
    further = {}
    if rigs is not None:
        further = colmap_rigs.contents_of(rigs, views.poses.camera, as_text=as_text)
    elif len(set(index)) > 1 and (rig.rig_from_camera[1:] != rig.rig_from_camera[:1]).any():
        notes.append("places of cameras on the rig are left out: each image has its own pose")
    rows = [
        (number + 1, *quaternion, *motion[:3, 3].tolist(), index[number] + 1)
        for number, (quaternion, motion) in enumerate(
            zip(quaternions.tolist(), motions, strict=True)
        )
    ]
    if as_text:
        if any(" " in image for image in images):
            notes.append("COLMAP ends names of a text model at spaces; write the binary one")
        cameras = [
            f"{number + 1} {model.name} {camera.width} {camera.height} "
            + " ".join(map(repr, values))
            for number, (camera, (model, values)) in enumerate(zip(rig.cameras, found, strict=True))
        ]
        lines = [
            line
            for row, image in zip(rows, images, strict=True)
            for line in (f"{' '.join(map(repr, row))} {image}", "")
        ]
        head = "# Camera list: CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"
        head += f"\n# Number of cameras: {len(cameras)}"
        image_head = "# Image list: IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME; POINTS2D"
        image_head += f"\n# Number of images: {len(images)}"
        return {
            "cameras.txt": "\n".join([head, *cameras, ""]).encode(),
            "images.txt": "\n".join([image_head, *lines, ""]).encode(),
            "points3D.txt": b"# 3D point list: none\n",
            **further,
        }
    data = struct.pack("<Q", len(found))
    for number, (camera, (model, values)) in enumerate(zip(rig.cameras, found, strict=True)):
        data += struct.pack("<IiQQ", number + 1, IDS[model.name], camera.width, camera.height)
        data += struct.pack(f"<{len(values)}d", *values)
    pieces = [struct.pack("<Q", len(rows))]
    for row, image in zip(rows, images, strict=True):
        pieces.append(struct.pack("<I7dI", *row) + image.encode() + b"\0" + struct.pack("<Q", 0))
    return {
        "cameras.bin": data,
        "images.bin": b"".join(pieces),
        "points3D.bin": struct.pack("<Q", 0),
        **further,
    }


def write(folder: Path, contents: Mapping[str, bytes], *, overwrite: bool) -> None:
    """Write the files of a model; a model that is there is replaced as a whole, if at all."""
    if folder.exists() and not folder.is_dir():
        raise ConfigError("a folder for the COLMAP model wanted, got a file; give another name")
    others = [folder / f"{name}.{end}" for name in FILES for end in ("bin", "txt")]
    there = [path for path in others if path.exists()]
    if there and not overwrite:
        raise ConfigError(f"{there[0].name} is there already; give another folder, or --overwrite")
    is_new = not folder.exists()
    folder.mkdir(exist_ok=True)
    try:
        with ExitStack() as stack:  # all are written before any takes its place
            for name, data in contents.items():
                stack.enter_context(writing(folder / name)).write_bytes(data)
    except BaseException:
        if is_new and not any(folder.iterdir()):
            folder.rmdir()
        raise
    for path in there:
        if path.name not in contents:
            path.unlink()  # of the model that was replaced: the new one has no such part
