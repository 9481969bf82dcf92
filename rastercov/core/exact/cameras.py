"""Cameras as the engine takes them: pinholes, parallel rays, and lenses with ideal planes."""

from rastercov.core.camera import Camera
from rastercov.engine import solver_visibility


def engine_camera(camera: Camera) -> solver_visibility.Camera:
    """Camera for the solvers of the engine; that of a lens takes seconds the first time."""
    kind = float(camera.near), camera.is_parallel
    own = solver_visibility.Camera(pinhole_numbers(camera), *kind)
    if camera.is_curved:
        from rastercov.core.camera.lenses.of_camera import ideal_camera, planes_of

        for each in planes_of(camera):
            own.add_plane(each.record, pinhole_numbers(ideal_camera(camera, each)))
    return own


def pinhole_numbers(camera: Camera) -> tuple[float, float, float, float, float, float]:
    """Focal lengths, principal point and size of an image, px; of parallel rays px/m first."""
    focal, centre = (float(camera.fx), float(camera.fy)), (float(camera.cx), float(camera.cy))
    return *focal, *centre, float(camera.width), float(camera.height)
