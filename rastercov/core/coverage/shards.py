"""Shards of an evaluation: what a report needs of some poses, kept until the report is whole.

A long run writes what it has in shards, so that one which was ended continues where it was; and
workers can make them. A folder holds the inputs and, with the checksum of each,
shards/shard-*.npz: sums of a network, rows of the table, coverage of pictures, regions. Frames are
a unit in place of poses where `store_in` is given them.

Inputs of a job in the folder of its shards, so that each worker reads them once.

header.json   all that the shards depend on, with hashes
scene.npz     mesh and cameras
poses.npz     poses, (P, 4, 4) world_from_camera; ids and camera, (P,) each; further tables

Provenance of a result: inputs with their hashes, thresholds, device and versions.
"""

import hashlib
import io
import json
import logging
import platform
import re
import zipfile
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

import rastercov
from rastercov.base import (
    AnyArray,
    ByName,
    ReadByName,
    json_text,
    offsets_of,
    own_folder,
    remove_folder,
)
from rastercov.base.output import name_folder, own_place
from rastercov.base.versions import version_of
from rastercov.core.area.regions import RegionObserver
from rastercov.core.area.table import Regions, join
from rastercov.core.camera import (
    Camera,
    Cameras,
    Poses,
    Rig,
    cameras_of,
    eyes_of,
    gates_of,
    names_of,
)
from rastercov.core.camera.rig import entries_of, rig_of_json, rig_to_json
from rastercov.core.coverage.coverage import Observer, open_observer
from rastercov.core.coverage.face_pass import ROW_TYPES, Sums, merge, no_sums
from rastercov.core.coverage.judging import NO_ARRAYS, JudgedPoses, leads_of
from rastercov.core.coverage.network import Network, NetworkOfBits
from rastercov.core.coverage.task import Engine, Task
from rastercov.core.mesh import Group, Mesh
from rastercov.core.mesh.mesh import MeshSource
from rastercov.core.raster.contract import RasterizerInfo, bits_of
from rastercov.shards import ShardStore, Staff, fill
from rastercov.shards.run import count_poses_of
from rastercov.shards.store import DamagedError, Note, renew, whole
from rastercov.shards.store import remove as remove_files
from rastercov.shards.work import FolderLostError


def provenance_of(
    mesh: Mesh,
    camera: Cameras,
    poses: NDArray[np.float64],
    task: Task | None = None,
    options: ReadByName | None = None,
    measured_by: RasterizerInfo | None = None,
    packages: Sequence[str] = ("moderngl", "numpy"),
) -> ByName:
    """Inputs of a result, and the device that measured it, ready for JSON.

    "mesh" has the files as read, "scene" the faces in metres; "camera" is the one camera, "cameras"
    are several, with their names where they have any.

    Parameters
    ----------
    mesh, camera
        The scene, and the camera that sees it, or several.
    poses : (P, 4, 4) float64
        world_from_camera, with those that were rejected.
    task : Task, optional
        Thresholds, where the result has any.
    options : mapping, optional
        Options of the run, ready for JSON.
    measured_by : RasterizerInfo, optional
    packages : sequence of str
        Packages whose versions are recorded beside ours; None for one that is not installed.
    """
    optional = {
        "task": task._entries() if task else None,
        "options": dict(options) if options is not None else None,
        "measured_by": asdict(measured_by) if measured_by else None,
    }
    return {
        "mesh": [source.to_json() for source in mesh.sources] or [{"name": "arrays"}],
        "scene": {
            "sha256": sha256(mesh.vertices, mesh.faces, mesh.face_group),
            "n_faces": mesh.n_faces,
            "groups": [group.to_json() for group in mesh.groups],
        },
        "poses": {"sha256": sha256(poses), "n_poses": len(poses)},
        **plain_cameras(camera),
        **{name: entry for name, entry in optional.items() if entry is not None},
        "versions": {
            "python": platform.python_version(),
            "rastercov": rastercov.__version__,
            **{name: version_of(name) for name in packages},
        },
    }


def plain_cameras(camera: Cameras) -> ByName:
    """Entry "camera" of one camera, or "cameras" with the names of all, ready for JSON.

    Of a rig with a rule, that and the thresholds of its cameras, too.
    """
    cameras = cameras_of(camera)
    return {"camera": cameras[0].to_json()} if len(cameras) == 1 else name_cameras(camera)


def name_cameras(camera: Cameras) -> ByName:
    """Entry "cameras" with the names of all, as of `plain_cameras` of several."""
    entries = [
        {"name": name} | each.to_json()
        for name, each in zip(names_of(camera), cameras_of(camera), strict=True)
    ]
    return {"cameras": entries} | (entries_of(camera) if isinstance(camera, Rig) else {})


def sha256(*parts: AnyArray | str) -> str:
    """SHA-256 of arrays, their dtypes and shapes, and texts."""
    total = hashlib.sha256()
    for part in parts:
        if isinstance(part, str):
            total.update(part.encode())
        else:
            total.update(f"{part.dtype.str} {part.shape}".encode())
            total.update(np.ascontiguousarray(part).data)
    return total.hexdigest()


T = TypeVar("T")
ARRAYS = ("vertices", "faces", "face_group", "source_face")
HEADER, SCENE, POSES = "header.json", "scene.npz", "poses.npz"
INPUTS = (SCENE, POSES, HEADER)
"""Files in the order in which they are written: where the last one is, all are."""
OPEN = 2
"""Jobs that a worker keeps open: those of a plan, and of its cavities."""


class Inputs(NamedTuple):
    """Header of a job, its mesh, cameras and poses."""

    header: ByName
    mesh: Mesh
    cameras: Cameras
    poses: Poses


def header_bytes(header: ReadByName) -> bytes:
    """File of a header; equal headers give the same bytes."""
    return json_text(header).encode() + b"\n"


def write_inputs(
    folder: Path,
    header: ReadByName,
    mesh: Mesh,
    cameras: Cameras,
    poses: Poses,
    note: Note,
    **arrays: object,
) -> None:
    """Write all files that are not there with this content; `note` names damaged ones.

    Other arrays go to the file of poses.
    """
    placed = {"poses": poses.world_from_camera, "ids": poses.ids, "camera": poses.camera}
    files = (_scene_bytes(mesh, cameras), npz_bytes(placed | arrays), header_bytes(header))
    for name, data in zip(INPUTS, files, strict=True):
        renew(folder, name, data, note)


def _scene_bytes(mesh: Mesh, cameras: Cameras) -> bytes:
    words = {
        "groups": [group.to_json() for group in mesh.groups],
        "sources": [source.to_json() for source in mesh.sources],
        "notes": list(mesh.notes),
        "cameras": [camera.to_json() for camera in cameras_of(cameras)],
        **({"rules": rules} if (rules := rig_to_json(cameras)) else {}),
    }
    arrays = {name: getattr(mesh, name) for name in ARRAYS}
    text = np.frombuffer(json.dumps(words, sort_keys=True).encode(), np.uint8)
    return npz_bytes(arrays | {"words": text})


def npz_bytes(arrays: ReadByName, *, level: int = 0) -> bytes:
    """File of arrays by their names, as `numpy.load` reads it; equal arrays give the same bytes.

    `level` is that of zlib, 0 for none.
    """
    file = io.BytesIO()
    kind = zipfile.ZIP_DEFLATED if level else zipfile.ZIP_STORED
    with zipfile.ZipFile(file, "w", kind, compresslevel=level) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as part:
                np.lib.format.write_array(part, np.asanyarray(array), allow_pickle=False)
    return file.getvalue()


def read_npz(data: bytes, names: Collection[str] | None = None) -> ByName:
    """Arrays of a file that `npz_bytes` made, or those of some names that are there."""
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        return {name: file[name] for name in file if names is None or name in names}


def read_poses(folder: Path) -> Poses:
    """Poses of a job; DamagedError as of `whole`."""
    npz = read_npz(whole(folder, POSES))
    return Poses(npz["poses"], npz["ids"], npz["poses"], {}, npz["camera"])


def read_inputs(folder: Path) -> Inputs:
    """All inputs of a job; DamagedError as of `whole`."""
    arrays = read_npz(whole(folder, SCENE))
    words = json.loads(arrays.pop("words").tobytes())
    mesh = Mesh(
        **arrays,
        groups=[Group(**group) for group in words["groups"]],
        sources=[MeshSource(**source) for source in words["sources"]],
        notes=words["notes"],
    )
    cameras = rig_of_json([Camera(**each) for each in words["cameras"]], words.get("rules", {}))
    return Inputs(json.loads(whole(folder, HEADER)), mesh, cameras, read_poses(folder))


def open_once(open_job: Callable[[Path, Inputs], T]) -> Callable[[Path], T]:
    """Function of a folder that opens a job; it stays open in this process, until two others are.

    Raises
    ------
    FolderLostError
        By the function, where the inputs are not there.
    """

    @lru_cache(OPEN)
    def open_inputs(folder: Path, modified: int) -> T:
        try:
            inputs = read_inputs(folder)
        except DamagedError as error:
            raise FolderLostError(str(error)) from None
        return open_job(folder, inputs)

    def of(folder: Path) -> T:
        try:
            modified = (folder / HEADER).stat().st_mtime_ns
        except OSError:
            raise FolderLostError(f"{folder}: expected {HEADER}, got no such file") from None
        return open_inputs(folder, modified)

    return of


LOG = logging.getLogger("rastercov")
FUNCTION = "rastercov.core.coverage.shards:make"
"""Function by which workers make a shard."""
PAIRS_A_SHARD = 1 << 19
"""Pose-face pairs of one shard: a tenth of a second of work or more, and some 50 MB of regions."""
PAIRS_OF_COUNTS = 1 << 25
"""The same where samples are counted and no pair is kept but as a bit: 4 MB, half a second."""
UNFINISHED = "unfinished"
"""Folder in that of a report, for the shards of a run until its report is whole."""
LONG_RUN = 128
"""Shards from which on a run is kept: shorter ones are done again in a minute or two."""
FILES = (
    "shards/shard-*.npz",
    *(f"{folder}.*.part" for folder in ("", "shards/", "quarantine/", "sha256/")),
    "quarantine/shard-*.json",
    *INPUTS,
    "sha256/*.sha256",
)
"""Files of a folder, in an order of removal that is safe to interrupt."""
OF_REGIONS = (
    *("xy", "starts", "face", "pose", "pair_pose", "pair_face"),
    *("area", "bound", "excess", "cut_short"),
)
"""Arrays of `Regions` in a shard."""


@dataclass(frozen=True)
class Wanted:
    """Figures that are kept of each pose; all of it is in the header.

    Attributes
    ----------
    engine : Engine
    by_area : bool
        True where regions are kept.
    pairs : str
        Rows of the table, of `rastercov.core.coverage.judging.CHOICES`.
    apart : bool
        True where the sums of each camera are kept apart.
    bits : bool
        True where the covered pairs are kept as bits.
    alone : bool
        True where nothing else is kept; see `NetworkOfBits`.
    """

    engine: Engine
    by_area: bool
    pairs: str = "none"
    apart: bool = False
    bits: bool = False
    alone: bool = False

    @property
    def kept(self) -> ByName:
        """Arguments of `Network.judge`."""
        return {"pairs": self.pairs, "apart": self.apart, "bits": self.bits}

    def network(
        self, mesh: Mesh, task: Task, measure: Callable[[], Network] | None = None
    ) -> Network:
        """Network of some poses; `measure` as for `NetworkOfBits`."""
        return NetworkOfBits(mesh, task, measure) if self.alone else Network(mesh, task)


class PoseShards(Generic[T]):
    """Shards of some poses in a folder of its own, which is made; a subclass has their content.

    The caller holds the lock of the folder above.

    Parameters
    ----------
    folder : Path
        Folder of unfinished runs; that of this one is named by a hash in it.
    observer : Observer
        Of the mesh and the cameras, by the engine; see `open_for`.
    poses : Poses
    task : Task
    wanted : Wanted
    """

    function: ClassVar[str]
    """By which workers make a shard."""

    def __init__(
        self, folder: Path, observer: Observer, poses: Poses, task: Task, wanted: Wanted
    ) -> None:
        self.observer, self.poses, self.task, self.wanted = observer, poses, task, wanted
        header = header_of(observer, poses, task, wanted) | self._more
        scene = observer.mesh, observer.camera, poses
        store = store_in(folder, header, len(poses), self.function, scene)
        self.store = replace(store, device=device_of(observer))

    _more: ClassVar[ByName] = {}
    """Further entries of the header."""

    def _measure(self, poses: Poses, did: Callable[[int], None]) -> dict[str, AnyArray]:
        """Arrays of a shard of some poses; `did` is called with the poses that are done."""
        raise NotImplementedError  # each has its own

    def _part(self, arrays: dict[str, AnyArray], poses: Poses) -> T:
        """A shard of some poses from its arrays."""
        raise NotImplementedError  # each has its own

    @property
    def quarantined(self) -> dict[int, str]:
        """Poses, by their ids, that were left out because they kill their process."""
        return {int(self.poses.ids[row]): end for row, end in self.store.quarantined().items()}

    def parts(self, staff: Staff) -> Iterator[T]:
        """Every shard in turn, as of `classify_parts`."""
        store = self.store
        made: dict[int, bytes] = {}

        def make(number: int, did: Callable[[int], None]) -> bytes:
            poses = self.poses[store.rows(number)]
            arrays = self._measure(poses, did)
            made[number] = pack_rows(store.folder, number, arrays)
            return made[number]

        for number in fill(store, make, partial(unpack_rows, store), staff):
            arrays = unpack_rows(store, number, made.pop(number, None))
            yield self._part(arrays, self.poses[store.rows(number)])

    def regions(self, arrays: Mapping[str, AnyArray], poses: Poses) -> Regions | None:
        """Regions of the poses of a shard, where they are kept."""
        if not self.wanted.by_area:
            return None
        own: Any = under("regions", arrays)
        own |= {"mesh": self.observer.mesh, "camera": self.observer.camera, "task": self.task}
        own["conditions"] = getattr(self.observer, "conditions", ())
        return Regions(pose_ids=poses.ids, eyes=eyes_of(self.observer.camera, poses), **own)


class EvaluationShards(PoseShards[JudgedPoses]):
    """Shards of one evaluation."""

    function = FUNCTION

    def _measure(self, poses: Poses, did: Callable[[int], None]) -> dict[str, AnyArray]:
        return _measure_poses(self.observer, poses, self.task, self.wanted, did)

    def _part(self, arrays: dict[str, AnyArray], poses: Poses) -> JudgedPoses:
        own_bits: Any = under("bits", arrays)
        left = poses[np.isin(poses.ids, arrays["ids"])]
        cameras = {path.split(".")[1] for path in arrays if path.startswith("sums.")}
        return JudgedPoses(
            poses=left,
            clipped=arrays["clipped"],
            rows=under("rows", arrays),
            counts=None,
            sums={int(each): Sums(**under(f"sums.{each}", arrays)) for each in sorted(cameras)},
            regions=self.regions(arrays, left),
            eyes=eyes_of(self.observer.camera, left),
            leads=leads_of(self.observer.camera, left),
            bits=bits_of(self.observer.mesh, **own_bits) if self.wanted.bits else None,
        )


def pack_rows(folder: Path, number: int | None, arrays: Mapping[str, AnyArray]) -> bytes:
    """File of a shard, with the run in the folder and the number that it is of."""
    return npz_bytes({**arrays, "of": np.array(f"{folder.name} {number}")})


def unpack_rows(store: ShardStore, number: int, data: bytes | None = None) -> dict[str, AnyArray]:
    """Arrays of a shard; DamagedError for one of another run, and as of `ShardStore.read`."""
    arrays = read_npz(data or store.read(number) or b"")
    if str(arrays.pop("of", "")) != f"{store.folder.name} {number}":
        why = "a shard of another run or of other poses"
        raise DamagedError(store.folder / store.name(number), why)
    return arrays


def store_in(
    above: Path,
    header: ReadByName,
    n: int,
    function: str,
    scene: tuple[Mesh, Cameras, Poses],
    **arrays: NDArray[np.generic],
) -> ShardStore:
    """Shards of n poses, or frames, in a folder that is named by the hash of their header."""
    own = above / hashlib.sha256(header_bytes(header)).hexdigest()[:16]
    own_folder(name_folder(above) / own.name)
    mesh, cameras, poses = scene
    write_inputs(own, header, mesh, cameras, poses, LOG.warning, **arrays)
    return ShardStore(own, "shards/shard-{}.npz", n, header["poses_a_shard"], function)


def remove(report: Path) -> None:
    """Remove the shards of all runs in the folder of a report; only files that are known.

    A link or a file in the place of their folder stays.
    """
    above = report / UNFINISHED
    if above.is_dir() and not above.is_symlink():
        for folder in above.glob("[0-9a-f]" * 16):
            remove_files(folder, FILES)
        remove_folder(above)


def folder_of_shards(folder: Path) -> Path:
    """Folder in that of a report for the shards of its run; ConfigError for a link."""
    return own_place(folder / UNFINISHED)


def classify_parts(
    network: Network,
    observer: Observer,
    poses: Poses,
    wanted: Wanted,
    shards: EvaluationShards | None,
    staff: Staff,
    more: ReadByName = NO_ARRAYS,
) -> Iterator[JudgedPoses]:
    """Judged poses of an evaluation, in the order of the poses.

    By way of shards where the run is kept in some, else the network judges what the observer, of
    `open_for`, measures, by `more` arguments of `classify_poses`. An interrupt while workers are
    busy is raised after the shards that are there.
    """
    if shards is not None:
        yield from shards.parts(staff)
        return
    did = count_poses_of(len(poses), staff.progress)
    for batch in network._judge(observer, poses, wanted.kept | {**more}):
        yield batch
        did(len(batch.poses))


def is_long(n_poses: int, n_faces: int) -> bool:
    """True for a run that is kept in shards."""
    return n_poses * n_faces > LONG_RUN * PAIRS_A_SHARD


def make(folder: Path, number: int | None, chosen: NDArray[np.int64]) -> bytes:
    """Content of a shard, as `rastercov.shards.ShardStore` wants it."""
    observer, poses, task, wanted = open_inputs(folder)
    return pack_rows(folder, number, _measure_poses(observer, poses[chosen], task, wanted))


def open_for(mesh: Mesh, camera: Cameras, task: Task, wanted: Wanted) -> Observer:
    """Observer by the engine, which finds regions, too, where the result is by area."""
    if wanted.by_area:
        return RegionObserver(mesh, camera, task, wanted.engine)
    return open_observer(mesh, camera, wanted.engine)


@open_once
def open_inputs(folder: Path, inputs: Inputs) -> tuple[Observer, Poses, Task, Wanted]:
    """Observer of a folder, its poses, thresholds and figures."""
    task, wanted = question_of(inputs)
    return open_for(inputs.mesh, inputs.cameras, task, wanted), inputs.poses, task, wanted


def question_of(inputs: Inputs) -> tuple[Task, Wanted]:
    """Thresholds and figures of a folder."""
    entries = inputs.header["wanted"]
    engine = Engine(**entries["engine"] | {"threads": 1})
    return Task(**inputs.header["task"]), Wanted(**entries | {"engine": engine})


def header_of(observer: Observer, poses: Poses, task: Task, wanted: Wanted) -> ByName:
    """Entries of the header of a folder, ready for JSON.

    Devices of one kind share a folder, a process each: their numbers are left out.
    """
    device = re.sub(r"^egl:\d+$", "egl", wanted.engine.device)
    engine = replace(wanted.engine, threads=None, device=device)
    is_small = engine.method == "sampled" and wanted.pairs == "none"
    size = PAIRS_OF_COUNTS if is_small else PAIRS_A_SHARD
    return inputs_of(observer, poses, task, observer.mesh.n_faces, size) | {
        "wanted": asdict(replace(wanted, engine=engine))
    }


def info_of(observer: Observer) -> ByName:
    """Method and device of shards, ready for JSON; of OpenGL without the number of the device."""
    info = observer.info
    return asdict(replace(info, device="") if info.backend == "gl" else info)


def device_of(observer: Observer) -> str:
    """Label of the device of OpenGL that an observer counts on, "" for none."""
    return observer.info.device.split()[0] if observer.info.backend == "gl" else ""


def inputs_of(
    observer: Observer, poses: Poses, task: Task, n_elements: int, pairs_a_shard: int
) -> ByName:
    """Entries of a header on scene, poses and method, and the size of shards, ready for JSON."""
    mesh = observer.mesh
    cameras = [json.dumps(each.to_json(), sort_keys=True) for each in cameras_of(observer.camera)]
    if rules := rig_to_json(observer.camera):
        cameras.append(json.dumps(rules, sort_keys=True))
    together = max((gate.n for gate in gates_of(observer.camera).values()), default=1)
    size = max(1, pairs_a_shard // max(1, n_elements) // together) * together
    groups = json.dumps([group.to_json() for group in mesh.groups])
    return {
        "rastercov": rastercov.__version__,
        "mesh": sha256(mesh.vertices, mesh.faces, mesh.face_group, groups),
        "camera": sha256(*cameras),
        "poses": hash_of(poses),
        "task": asdict(task),
        "measured_by": info_of(observer),
        "poses_a_shard": size,
    }


def hash_of(poses: Poses) -> str:
    """SHA-256 of poses, their ids and cameras."""
    return sha256(poses.world_from_camera, poses.ids, poses.camera)


def _measure_poses(
    observer: Observer,
    poses: Poses,
    task: Task,
    wanted: Wanted,
    did: Callable[[int], None] = lambda n_poses: None,
) -> dict[str, AnyArray]:
    """Arrays of a shard of some poses; `did` is called with the poses that are done."""
    network, batches = wanted.network(observer.mesh, task), []
    for batch in network._judge(observer, poses, wanted.kept):
        batches.append(batch)
        did(len(batch.poses))
    arrays = {"ids": poses.ids} | _join_batches(poses, batches)
    if wanted.by_area:
        arrays |= below("regions", arrays_of_regions([batch.regions for batch in batches]))
    return arrays


def _join_batches(poses: Poses, batches: Sequence[JudgedPoses]) -> dict[str, AnyArray]:
    """Arrays of all batches of some poses, whatever their sizes and the number of threads."""
    ends = offsets_of([len(batch.poses) for batch in batches])
    sums: dict[int, Any] = {}
    for first, batch in zip(ends, batches, strict=False):
        for camera, part in batch.sums.items():
            merge(sums.setdefault(camera, no_sums(len(part.views), len(poses))), part, int(first))
    rows = {each: np.concatenate([batch.rows[each] for batch in batches]) for each in ROW_TYPES}
    arrays = {"clipped": np.concatenate([batch.clipped for batch in batches])}
    if kept := [batch.bits for batch in batches if batch.bits is not None]:
        of_poses = [(each.packed, each.area_units) for each in kept]
        packed, areas = map(np.concatenate, zip(*of_poses, strict=True))
        views = np.sum([each.views for each in kept], axis=0)
        arrays |= below("bits", {"packed": packed, "area_units": areas, "views": views})
    arrays |= below("rows", rows)
    for camera, part in sorted(sums.items()):
        arrays |= below(f"sums.{camera}", part._asdict())
    return arrays


def below(path: str, arrays: Mapping[Any, AnyArray]) -> dict[str, AnyArray]:
    """Arrays by their paths in a file, such as "sums.0.views"."""
    return {f"{path}.{name}": array for name, array in arrays.items()}


def under(path: str, arrays: Mapping[str, AnyArray]) -> dict[str, AnyArray]:
    """Arrays of a file below a path, by their names; see `below`."""
    own = f"{path}."
    return {name[len(own) :]: array for name, array in arrays.items() if name.startswith(own)}


def arrays_of_regions(values: Sequence[Any]) -> dict[str, AnyArray]:
    """Arrays of the regions of several batches, as those of one."""
    both = join(values)
    return {name: np.asarray(getattr(both, name)) for name in OF_REGIONS}
