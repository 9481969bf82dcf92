"""Cameras of Agisoft Metashape: the XML of "Export Cameras", and calibrations by themselves.

Poses are chunk_from_camera with our axes, and further sensors of a rig have master_from_camera. A
chunk, or each of its components, has a transform with a scale, to metres. Principal points are
counted from the middle of the image. Metashape's P1 and P2 are OpenCV's p2 and p1, and B1, B2 are
affinity and skew. PhotoScan up to 1.2 has fx, fy and skew, and principal points from the corner.

Source: Agisoft Metashape Professional manual 2.1, appendix C, "Camera models"; its files.
"""

import re
from collections import Counter
from xml.etree.ElementTree import Element

import numpy as np

from rastercov.base import CameraError, FloatArray, Vocabulary, matmul, shown
from rastercov.core.camera import PROGRAMS, Border, Camera, Views, lens_camera, share_frames
from rastercov.core.camera.conventions import motions, panorama
from rastercov.formats.cameras.source import Source, Words, check_ids
from rastercov.formats.meshes.xml_tree import children, local_name, look_at_names

MODELS = PROGRAMS["metashape"]
TERMS = MODELS["frame"].parameters.split()
KNOWN_TERMS = (*TERMS, "b1", "b2", "cx", "cy")
TERM = re.compile(r"[a-z][0-9]|c[xy]")
"""A coefficient; p3 and p4, of older versions, change the tangential terms."""


NAMES = Vocabulary(
    "document chunk sensors sensor cameras camera group components component transform "
    "calibration sensor_id component_id effective active_id",
    "reference rotation translation location scale text orientation resolution projection width "
    "height",
    "version id label type enabled active class date date_time fx fy skew name settings meta "
    "markers markers_groups scalebars frames images shapes model depth_maps point_cloud next_id "
    "next_group_id property properties bands covariance params data_type black_level sensitivity "
    "photo photo_params projections master_id layer_index rotation_covariance location_covariance "
    "camera_groups camera_ids component_ids partition region regions pixel_width pixel_height "
    "focal_length locked k1 k2 k3 k4 k5 k6 p1 p2 p3 p4 b1 b2 cx cy f",
)


def is_mine(root: Element) -> bool:
    """True for a document with chunks, and for a calibration."""
    return local_name(root) in ("document", "chunk", "calibration")


def read(source: Source, border: Border) -> Views:
    """Cameras and poses of the first chunk, or the camera of a calibration."""
    root = source.xml
    look_at_names(root, NAMES, border.unknown)
    if local_name(root) == "calibration":
        kind = Words(root, "calibration").text("projection", "frame")
        return border.views([_camera(root, kind, "calibration")])
    chunk = _chunk(root, border)
    sensors, places, mounts = _sensors(chunk, border), _places(chunk), _mounts(chunk)
    row_of = {key: row for row, key in enumerate(sensors)}
    index, images, matrices, scales, frames = [], [], [], set(), []
    left_out: Counter[str] = Counter()
    elements = _each(chunk, "cameras", "camera")
    by_id = {each.get("id"): _words(each) for each in elements}
    for element in elements:
        own = _words(element)
        sensor, master = own.text("sensor_id", ""), own.text("master_id", "")
        # A further camera of a rig has its place in the frame of the master, by its sensor.
        mount = mounts.get(sensor) if "transform" not in own and master else np.eye(4)
        if mount is not None and "transform" not in own:
            own = by_id.get(master, own)
        if not _is_enabled(element):
            left_out["left out: they are disabled"] += 1
        elif mount is None:
            left_out["of further cameras of a rig left out: their sensors have no location"] += 1
        elif "transform" not in own or sensor not in row_of:
            left_out["left out: they have no transform, or no calibrated sensor"] += 1
        else:
            matrix = matmul(own.array("transform", (16,)).reshape(4, 4), mount)
            place, scale = places.get(own.get("component_id"), places[None])
            matrix[:3, 3] *= 1.0 if scale is None else scale
            matrices.append(matmul(place, matrix))
            scales.add(scale)
            index.append(row_of[sensor])
            images.append(element.get("label", f"camera {element.get('id', '')}"))
            frames.append(master or element.get("id"))
    for why, count in left_out.items():
        border.note(f"{count} images {why}")
    if None in scales and len(scales) > 1:
        border.note(
            "some components have no scale: their lengths are not comparable with the others"
        )
    reference = Words(chunk, "chunk").text("reference", "")
    if reference.startswith(("GEO", "PROJ", "COMPD")) and None not in scales:
        border.note("the chunk is georeferenced: poses are geocentric, in metres")
    shared = share_frames(frames, images)
    on_rig = np.array([mounts.get(key, np.eye(4)) for key in sensors])
    on_rig[:, :3, 3] *= next(iter(scales), None) or 1.0
    return border.views(
        [camera for _, camera in sensors.values()],
        [label for label, _ in sensors.values()],
        world_from_camera=np.array(matrices).reshape(-1, 4, 4),
        camera=index,
        images=images,
        frames=shared,
        rig_from_camera=on_rig if shared and len(scales) == 1 else None,
        # Scale bars and coordinates of Metashape are in metres.
        metres=1.0 if matrices and None not in scales else None,
    )


def _chunk(root: Element, border: Border) -> Element:
    """The first chunk that is enabled; the first of a document whose chunks are all disabled."""
    chunks = [root] if local_name(root) == "chunk" else children(root, "chunk")
    if not chunks:
        raise CameraError("expected a chunk, got none; use File, Export, Export Cameras")
    enabled = [chunk for chunk in chunks if _is_enabled(chunk)] or chunks
    if len(chunks) > 1:
        which = "the first" if enabled[0] is chunks[0] else "the first enabled one"
        border.note(f"{which} of {len(chunks)} chunks; each has its own frame")
    return enabled[0]


def _words(element: Element) -> Words:
    return Words(element, f"camera {element.get('label', '')[:60]}")


def _mounts(chunk: Element) -> dict[str, FloatArray]:
    """Master_from_camera of the further sensors of a rig by id, in the unit of the chunk."""
    mounts = {}
    for sensor in _each(chunk, "sensors", "sensor"):
        own = Words(sensor, f"sensor {sensor.get('label', '')[:60]}")
        key = own.any_of("location", "translation")
        if "master_id" in own and "rotation" in own and key is not None:
            rotation = own.array("rotation", (9,)).reshape(1, 3, 3)
            mounts[sensor.get("id", "")] = motions(rotation, own.array(key, (3,)))[0]
    return mounts


def _is_enabled(element: Element) -> bool:
    """True unless a chunk or an image was disabled; exports before 1.4 have no such entry."""
    return element.get("enabled", "true").strip().lower() not in ("false", "0")


def _sensors(chunk: Element, border: Border) -> dict[str, tuple[str, Camera]]:
    """Labels and cameras of the sensors by id."""
    sensors: dict[str, tuple[str, Camera]] = {}
    without: list[str] = []
    for sensor in _each(chunk, "sensors", "sensor"):
        label = sensor.get("label", f"sensor {sensor.get('id', '')}")
        kind = sensor.get("type", "frame")
        result = children(sensor, "calibration")
        adjusted = [each for each in result if each.get("class") == "adjusted"]
        if result or kind == "spherical":
            camera = _camera((adjusted or result or [sensor])[0], kind, label, sensor)
            sensors[sensor.get("id", "")] = label, camera
        else:
            without.append(label)
    if without:
        more = f" (and {len(without) - 1} others)" if len(without) > 1 else ""
        border.note(f"sensor {shown(without[0])}{more} left out: it has no calibration")
    if not sensors:
        raise CameraError("expected a sensor with a calibration, got none; align the photos first")
    return sensors


def _camera(element: Element, kind: str, label: str, *sensor: Element) -> Camera:
    """Camera of a calibration; the size may be in the sensor."""
    what = f"sensor {shown(label)}"
    if kind not in MODELS:
        raise CameraError(
            f"{what}: expected its type to be one of {', '.join(MODELS)}, got {shown(kind)}"
        )
    values = Words(element, what)
    sizes = [size for holder in (element, *sensor) for size in children(holder, "resolution")]
    size = Words(sizes[0], what) if sizes else values
    width, height = size.side("width"), size.side("height")
    if kind == "spherical":
        if width != 2 * height:
            raise CameraError(
                f"{what}: expected a spherical image of 2:1, got {width} x {height}; its scale is "
                "not in the file"
            )
        return panorama(width, height)
    c = dict.fromkeys(KNOWN_TERMS, 0.0)
    c |= {name: values.number(name) for name in values.names() if TERM.fullmatch(name)}
    for name, value in c.items():
        if value and name not in KNOWN_TERMS:
            raise CameraError(
                f"{what}: expected no term {name}, which has no model here, got {value:g}; "
                "undistort the photos"
            )
    if "f" not in values and "fx" in values:  # of PhotoScan up to 1.2
        if c["p1"] or c["p2"]:
            raise CameraError(
                f"{what}: expected no p1 and p2 beside fx, got an old form with them; export it "
                "again with Metashape"
            )
        c |= {name: values.number(name) for name in ("fx", "fy")}
        c |= {"skew": values.number("skew", 0.0)}
        c |= {"cx": values.number("cx", width / 2), "cy": values.number("cy", height / 2)}
    else:
        f = values.number("f")
        c |= {"fx": f + c["b1"], "fy": f, "skew": c["b2"]}
        c |= {"cx": width / 2 + c["cx"], "cy": height / 2 + c["cy"]}
    return lens_camera(MODELS[kind].ours, (width, height), c)


def _places(chunk: Element) -> dict[str | None, tuple[FloatArray, float | None]]:
    """World_from_chunk and scale of each component by id, of the chunk at None."""
    values_by_key: dict[str | None, tuple[FloatArray, float | None]] = {None: _place(chunk)}
    for component in _each(chunk, "components", "component"):
        if children(component, "transform"):
            values_by_key[component.get("id")] = _place(component)
    return values_by_key


def _place(owner: Element) -> tuple[FloatArray, float | None]:
    place, scale = np.eye(4), None
    for transform in children(owner, "transform")[:1]:
        own = Words(transform, "transform of the chunk")
        if "rotation" in own:
            place[:3, :3] = own.array("rotation", (9,)).reshape(3, 3)
        if "translation" in own:
            place[:3, 3] = own.array("translation", (3,))
        if "scale" in own:
            scale = own.positive("scale")
    return place, scale


def _each(owner: Element, group: str, name: str) -> list[Element]:
    """Elements of a group in the order of the file, also those in groups within it."""
    elements: list[Element] = []
    stack = children(owner, group)[::-1]
    while stack:
        element = stack.pop()
        if local_name(element) == name:
            elements.append(element)
        else:
            stack += children(element, name, "group")[::-1]
    check_ids(name, [each.get("id") for each in elements if "id" in each.attrib])
    return elements
