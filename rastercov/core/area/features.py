"""Features that add to what cameras see: calls to all of them."""

from rastercov.base import ByName, FloatArray, WholeArray, hooks_of
from rastercov.core.area.carried import OfDevice
from rastercov.core.area.feature import Feature, Judge, PointCondition, Points, Scene
from rastercov.core.area.table import Regions
from rastercov.core.camera import Cameras, Poses
from rastercov.core.coverage.device import Device
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Mesh

FEATURES = (*hooks_of(Feature), *map(OfDevice, hooks_of(Device)))


def narrow(camera: Cameras, task: Task) -> Task:
    """The task within the limits that the equipment of cameras has."""
    for each in FEATURES:
        task = each.narrow(camera, task)
    return task


def conditions_at(
    mesh: Mesh, camera: Cameras, task: Task, points: FloatArray, face: WholeArray
) -> list[PointCondition]:
    """Conditions at points of faces, (N, 3) metres."""
    at_points = (each.at_points(mesh, camera, task, points, face) for each in FEATURES)
    return [each for each in at_points if each is not None]


def device_of(
    camera: Cameras, lead: Poses, point: FloatArray, normal: FloatArray, reason: int
) -> str | None:
    """Name of the device that fails a point, (3,), for a row of `REASONS`, in one pose."""
    devices = (each.device(camera, lead, point, normal, reason) for each in FEATURES)
    return next((name for name in devices if name is not None), None)


def measure_at(
    scene: Scene, points: FloatArray, face: WholeArray, lead: Poses, reason: int
) -> tuple[str, ByName]:
    """Words and entries on what points miss, (N, 3), for a row of `REASONS`, in one pose."""
    measures = (each.measure(scene, points, face, lead, reason) for each in FEATURES)
    return next((own for own in measures if own[0]), ("", {}))


def unmet_lines(judge: Judge, regions: Regions, scene: Scene, poses: Poses) -> list[str]:
    """Lines on limits that nothing meets, by the regions of each pose."""
    return [line for each in FEATURES for line in each.unmet(judge, regions, scene, poses)]


def limit_advice(
    judge: Judge, scene: Scene, poses: Poses, on: Points, *, is_tried: bool = True
) -> str:
    """Text on how far rigs in these poses miss limits, and what helps; "" for no limit."""
    advices = (each.advice(judge, scene, poses, on, is_tried=is_tried) for each in FEATURES)
    return next((text for text in advices if text), "")


def deviations_of(camera: Cameras, own: Poses, points: FloatArray) -> FloatArray | None:
    """(N,) standard deviations of points, metres, by the poses of a row; None for no limit."""
    deviations = (each.deviations(camera, own, points) for each in FEATURES)
    return next((own for own in deviations if own is not None), None)


def values_of(mesh: Mesh, camera: Cameras, task: Task) -> ByName:
    """Values of faces by the names of modes."""
    every = (each.values(mesh, camera, task).items() for each in FEATURES)
    return {name: own for some in every for name, own in some}
