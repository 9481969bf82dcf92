"""Peers: face counts of a pose by Open3D, trimesh with embreex, or VTK.

Each counts what `rastercov.open_rasterizer(...).count(poses, drawn=False)` counts, the way its own
manual does it, and is given what it can use again: the mesh once, the rays of the camera once.

pyrender is not among them: it runs headless (EGL), but its id pass gives a colour to a node, not to
a face, and its other passes blend edges by multisampling.
"""

import ctypes
import time
from importlib.metadata import PackageNotFoundError, version
from typing import Protocol

import numpy as np
from tracer import Tracer

import rastercov as rc

PAIRS_A_CALL = 8_000_000
"""Pose-face pairs that our rasterisers are asked for at a time: 31 MiB of counts.

glibc hands memory of up to 32 MiB back as it was; larger pieces come as new pages each time, which
at a million faces takes a tenth of a pose.
"""


class Runner(Protocol):
    """A renderer with its mesh, camera and poses."""

    def count(self, rows: np.ndarray) -> float:
        """Count the visible samples of each face in these poses; seconds that rays took to make."""
        ...

    def faces(self, row: int) -> np.ndarray:
        """(H, W) face at each pixel centre, -1 for none."""
        ...


class Ours:
    """One of our rasterisers."""

    def __init__(self, mesh, camera, poses, **options) -> None:
        self.poses = poses
        self.rasterizer = rc.open_rasterizer(mesh, camera, **options)
        self.step = max(4, PAIRS_A_CALL // mesh.n_faces)
        self.about = self.rasterizer.info.renderer

    def count(self, rows: np.ndarray) -> float:
        """As `Runner.count`."""
        for start in range(0, len(rows), self.step):
            self.rasterizer.count(self.poses[rows[start : start + self.step]], drawn=False)
        return 0.0

    def faces(self, row: int) -> np.ndarray:
        """As `Runner.faces`."""
        return self.rasterizer.render(self.poses[row]).face

    def counts(self, row: int) -> np.ndarray:
        """(F,) samples of each face, as counted."""
        return self.rasterizer.count(self.poses[row], drawn=False).visible[0]


class Open3D:
    """Open3D's RaycastingScene, which is Embree on all threads."""

    def __init__(self, mesh, camera, poses, threads) -> None:
        self.tracer = Tracer(mesh, camera, poses, threads)
        self.about = f"Open3D {version('open3d')}"

    def count(self, rows: np.ndarray) -> float:
        """As `Runner.count`."""
        both, casting = self.tracer.round(rows)
        return both - casting

    def faces(self, row: int) -> np.ndarray:
        """As `Runner.faces`."""
        return self.tracer.faces(row)


class Embreex:
    """trimesh's ray tracer on embreex, which is Embree on one thread."""

    def __init__(self, mesh, camera, poses) -> None:
        import trimesh
        from trimesh.ray.ray_pyembree import RayMeshIntersector

        self.poses, self.n_faces = poses, mesh.n_faces
        self.shape = camera.height, camera.width
        part = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
        # Not scaled: that is for parts that are very large or small, and moves the rays.
        self.tracer = RayMeshIntersector(part, scale_to_box=False)
        u, v = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
        x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
        self.directions = np.stack((x, y, np.ones_like(x)), axis=-1).reshape(-1, 3)
        self.about = f"trimesh {version('trimesh')}, embreex {version('embreex')}"

    def _rays(self, row: int) -> tuple[np.ndarray, np.ndarray]:
        directions = self.directions @ self.poses[row, :3, :3].T
        return np.broadcast_to(self.poses[row, :3, 3], directions.shape), directions

    def count(self, rows: np.ndarray) -> float:
        """As `Runner.count`."""
        making = 0.0
        for row in rows:
            started = time.perf_counter()
            rays = self._rays(row)
            making += time.perf_counter() - started
            intersects_first = self.tracer.intersects_first(*rays)
            np.bincount(intersects_first[intersects_first >= 0], minlength=self.n_faces)
        return making

    def faces(self, row: int) -> np.ndarray:
        """As `Runner.faces`."""
        return self.tracer.intersects_first(*self._rays(row)).reshape(self.shape)


class VTK:
    """VTK's hardware selector, offscreen through EGL: an id a cell, drawn as a colour."""

    ACTORS, CELL_IDS = 0, 5  # vtkHardwareSelector::PassTypes

    def __init__(self, mesh, camera, poses) -> None:
        # The classes of OpenGL register themselves when their module is loaded.
        import vtkmodules.vtkRenderingOpenGL2  # noqa: F401
        from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
        from vtkmodules.vtkCommonCore import vtkObject, vtkPoints
        from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
        from vtkmodules.vtkRenderingCore import (
            vtkActor,
            vtkHardwareSelector,
            vtkPolyDataMapper,
            vtkRenderer,
            vtkRenderWindow,
        )

        vtkObject.GlobalWarningDisplayOff()  # that there is no X server
        self.mesh, self.camera, self.poses = mesh, camera, poses
        points, cells, data = vtkPoints(), vtkCellArray(), vtkPolyData()
        # In float32, which the device gets, but from the middle of the part, which loses nothing.
        self.centre = mesh.bounds.mean(axis=0)
        points.SetData(numpy_to_vtk((mesh.vertices - self.centre).astype(np.float32), deep=True))
        cells.SetData(3, numpy_to_vtkIdTypeArray(mesh.faces.astype(np.int64).ravel(), deep=True))
        data.SetPoints(points)
        data.SetPolys(cells)
        mapper, actor = vtkPolyDataMapper(), vtkActor()
        mapper.SetInputData(data)
        mapper.ScalarVisibilityOff()
        actor.SetMapper(mapper)
        self.renderer, self.window = vtkRenderer(), vtkRenderWindow()
        self.renderer.AddActor(actor)
        self.window.SetOffScreenRendering(1)
        self.window.SetMultiSamples(0)
        self.window.SetSize(camera.width, camera.height)
        self.window.AddRenderer(self.renderer)
        self.window.Render()
        self.selector = vtkHardwareSelector()
        self.selector.SetRenderer(self.renderer)
        self.selector.SetFieldAssociation(1)
        self.selector.SetArea(0, 0, camera.width - 1, camera.height - 1)
        lines = self.window.ReportCapabilities().splitlines()
        device = next(line for line in lines if "OpenGL renderer" in line).partition(":")[2].strip()
        self.about = f"VTK {version('vtk')}, {device}"

    def _ids(self, row: int) -> np.ndarray:
        """(H, W) face at each pixel centre, -1 for none, with the rows from below."""
        pose = self.poses[row]
        view, eye = self.renderer.GetActiveCamera(), pose[:3, 3] - self.centre
        view.SetPosition(eye)
        view.SetFocalPoint(eye + pose[:3, 2])
        view.SetViewUp(-pose[:3, 1])
        view.SetViewAngle(np.rad2deg(2 * np.arctan(self.camera.height / 2 / self.camera.fy)))
        size = np.linalg.norm(np.ptp(self.mesh.bounds, axis=0))
        away = float(np.linalg.norm(eye))
        view.SetClippingRange(max(away - size / 2, 1e-3 * size), away + size / 2)
        self.selector.CaptureBuffers()
        red, green, blue = np.moveaxis(self._pass(self.CELL_IDS), -1, 0).astype(np.int32)
        has_actor = self._pass(self.ACTORS).any(axis=-1)
        return np.where(has_actor, red | green << 8 | blue << 16, -1)

    def _pass(self, number: int) -> np.ndarray:
        """(H, W, 3) colours of a pass: 24 bits of an id."""
        pointer = self.selector.GetPixelBuffer(number)
        shape = self.camera.height, self.camera.width, 3
        at = int(pointer.split("_")[1], 16)  # "_<address in hexadecimals>_p_void"
        bytes_there = (ctypes.c_ubyte * np.prod(shape)).from_address(at)
        return np.frombuffer(bytes_there, np.uint8).reshape(shape)

    def count(self, rows: np.ndarray) -> float:
        """As `Runner.count`."""
        for row in rows:
            ids = self._ids(row)
            np.bincount(ids[ids >= 0], minlength=self.mesh.n_faces)
        return 0.0

    def faces(self, row: int) -> np.ndarray:
        """As `Runner.faces`."""
        return self._ids(row)[::-1]


def what_is_missing(packages: tuple[str, ...]) -> str | None:
    """A line about the first of these packages that is not installed, None when all are."""
    for package in packages:
        try:
            version(package)
        except PackageNotFoundError:
            return f"{package} is missing: pip install 'rastercov[bench]'"
    return None
