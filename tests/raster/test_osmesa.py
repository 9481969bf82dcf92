"""OSMesa draws what EGL without a surface draws: it is the same renderer behind another door."""

import pytest
from coplanar_scenes import CAMERA as SMALL
from coplanar_scenes import SCENES as COPLANAR
from coplanar_scenes import scene_of as coplanar_scene
from image_laws import assert_same, assert_same_image, everything, reference_view
from test_raster_laws import CAMERA, SCENES, scene_of

from rastercov.gl import GLRasterizer

ALL = [(CAMERA, name, scene_of) for name in SCENES]
ALL += [(SMALL, kind, lambda kind: coplanar_scene(kind, 5)) for kind in COPLANAR]


@pytest.mark.slow
@pytest.mark.parametrize(("camera", "name", "made"), ALL, ids=lambda value: str(value)[:12])
def test_osmesa_gives_the_bits_of_egl_or_the_image_of_the_reference(
    osmesa_context, gl_context, plan, camera, name, made
):
    mesh, poses = made(name)

    def seen(context):
        with GLRasterizer(mesh, camera, device=context, plan=plan) as rasterizer:
            return everything(rasterizer, poses)

    observation = seen(osmesa_context)
    if osmesa_context.info.version == gl_context.info.version:
        assert_same(observation, seen(gl_context))
    else:
        for pose, face in zip(poses, observation["face"], strict=True):
            assert_same_image(face, reference_view(mesh, camera, pose).face, mesh, camera, pose)
