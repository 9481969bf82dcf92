"""Loops that a first evaluation after installation needs, as far as another process compiles them.

`exact.certificate` starts that process, and compiles the others meanwhile.
"""

from rastercov.camera.pose import Poses
from rastercov.cluster import ALONE
from rastercov.coverage.area.network import AreaNetwork
from rastercov.coverage.engine import Engine
from rastercov.coverage.network import Network
from rastercov.coverage.shards import Wanted, judged_parts, open_for
from rastercov.coverage.task import Task
from rastercov.exact import certificate
from rastercov.raster.self_test import CAMERA, MESH, POSES


def compile_half() -> None:
    """Compile about half of them: the rasteriser, and what an evaluation by area needs.

    The latter runs by half planes, whose loops the other process has compiled by then; those of the
    certificate come later there.
    """
    certificate.COMPILED.get(lambda: None)  # by that process
    task, poses = Task(max_incidence_deg=75.0), Poses.of(POSES)
    for engine in (Engine("sampled", "cpu"), Engine("exact")):
        network, areas = Network(MESH, task), AreaNetwork(MESH, task)
        wanted = Wanted(engine, engine.method == "exact", "seen", (), False)
        with open_for(MESH, CAMERA, task, wanted) as observer:
            for batch in judged_parts(network, observer, poses, wanted, None, ALONE):
                network.add(batch)
                if batch.regions is not None:
                    areas.add(batch.regions)
        if wanted.by_area:
            areas.add_to(network.summary())
            areas.dead_zones(CAMERA, poses)
