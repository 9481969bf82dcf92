"""Motion in what leaves a report: the animation of a glTF file, and the frames of a page."""

import numpy as np

from rastercov.base import TINY, ByName, FloatArray
from rastercov.core.mesh.arrays import quaternions_of
from rastercov.formats.meshes.gltf_file import GlbBuffer
from rastercov.motion.motion import Motion, describe_motion
from rastercov.motion.over_time import OverTime, time_words
from rastercov.report.coverage_files import Addition
from rastercov.report.feature import MOST_LEVELS, InPhases


def animate_motion(motion: Motion) -> Addition:
    """Animation of the nodes of groups that move, about the centre; what is absent has no size.

    The end of the last frame has the values of it again: players stop there.
    """
    mesh, centre = motion.mesh, motion.mesh.centre

    def add_to(buffer: GlbBuffer, nodes: list[ByName], roots: list[int]) -> ByName:
        names = [group.name for group in mesh.groups]
        times = np.concatenate(([0.0], np.cumsum(motion.durations)))
        at = buffer.add(times.astype(np.float32), with_range=True)
        samplers: list[ByName] = []
        channels: list[ByName] = []

        def add(node: int, path: str, values: FloatArray) -> None:
            values = np.concatenate((values, values[-1:])).astype(np.float32)
            samplers.append({"input": at, "output": buffer.add(values), "interpolation": "STEP"})
            channels.append({"sampler": len(samplers) - 1, "target": {"node": node, "path": path}})

        turn, *_ = [node.pop("matrix") for node in nodes]
        for index, node in enumerate(nodes):
            members = np.flatnonzero(mesh.face_group == names.index(node["name"]))
            body = int(motion.body[members[0]])
            pose, there = motion.world_from_body[:, body], motion.present[:, body]
            if (pose != np.eye(4)).any():
                add(index, "rotation", quaternions_of(pose[:, :3, :3])[:, [1, 2, 3, 0]])
                add(index, "translation", pose[:, :3, :3] @ centre + pose[:, :3, 3] - centre)
            if not there.all():
                add(index, "scale", np.repeat(there.astype(np.float64)[:, None], 3, axis=1))
        if not channels:
            add(0, "translation", np.zeros((len(motion), 3)))
        nodes.append({"name": "z up", "children": roots.copy(), "matrix": turn})
        roots[:] = [len(nodes) - 1]
        return {"animations": [{"name": "motion", "samplers": samplers, "channels": channels}]}

    return add_to


def show_phases(over_time: OverTime) -> InPhases:
    """Frames of coverage over time as a page shows them, unless they are too many."""
    mesh = over_time.motion.mesh
    entries = {
        "motion": describe_motion(over_time.motion),
        "when": time_words(over_time.asked.over),
    }
    if len(over_time.motion) * mesh.n_faces > MOST_LEVELS:
        return InPhases(entries, "now", ())
    shares = over_time.frames.areas() / np.maximum(mesh.areas, TINY)
    return InPhases(entries, "now", shares)
