"""Tensors of other libraries are arrays, through DLPack where numpy does not convert them."""

import numpy as np
import pytest

import rastercov as rc


class Tensor:
    """A tensor of another library; numpy makes an object of it."""

    def __init__(self, array):
        self.array = array

    def __dlpack__(self, **options):
        return self.array.__dlpack__(**options)

    def __dlpack_device__(self):
        return self.array.__dlpack_device__()


class OnGPU(Tensor):
    """One that refuses numpy in words, as those of a GPU do."""

    def __array__(self, *given, **options):
        raise TypeError("use cpu() first")


class InVRAM(OnGPU):
    """One in memory of a GPU, which gives its values only to who asks for them on the host."""

    def __dlpack__(self, *, dl_device=None, **options):
        if dl_device != (1, 0):
            raise BufferError("not on this device")
        return super().__dlpack__(**options)

    def __dlpack_device__(self):
        return (2, 0)


class Old(Tensor):
    """One whose library knows no options of DLPack."""

    def __dlpack__(self):
        return super().__dlpack__()


@pytest.mark.parametrize("kind", [Tensor, OnGPU, InVRAM, Old, np.asarray])
def test_a_tensor_gives_what_its_array_gives(kind):
    mesh, camera = rc.shapes.torus(8, 6), rc.Camera.load("khepra")
    poses = rc.sphere_of_poses((0, 0, 0), 4, 3)
    again = rc.Mesh(kind(mesh.vertices.copy()), kind(mesh.faces.copy()))
    result = rc.evaluate(again, camera, kind(poses), fields=["coverage"])
    asked = rc.evaluate(mesh, camera, poses, fields=["coverage"])
    assert np.array_equal(np.from_dlpack(result.coverage), asked.coverage)
    with pytest.raises(rc.MeshError, match="faces to be integers"):
        rc.Mesh(kind(mesh.vertices.copy()), kind(mesh.vertices.copy()))
    with pytest.raises(rc.PoseError):
        rc.Poses.of(kind(poses.astype(np.complex128)))
