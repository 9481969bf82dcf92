"""Damage to the folder of a visibility matrix, and the verdict on what becomes of it.

Every kind of damage is a function of the folder, of one of another matrix, and of a generator of
random numbers; it says what it did. `verdict` reads the damaged folder, runs the build again, and
gives what went wrong, nothing where all is as it must be.
"""

import shutil

import numpy as np

from rastercov.base.errors import ConfigError
from rastercov.placement.matrix import VisibilityMatrix, build_matrix

ARRAYS = ("poses", "indptr", "face", "coverage")


def files_of(folder):
    """Files of a matrix, in order."""
    return sorted(path for path in folder.rglob("*") if path.is_file())


def contents_of(folder):
    """Bytes of every file by its name in the folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in files_of(folder)}


def _flipped(data, bits):
    data = bytearray(data)
    for bit in bits:
        data[bit // 8] ^= 1 << (bit % 8)
    return bytes(data)


def flip(path, bits):
    """Turn bits of a file over, numbered from its first."""
    path.write_bytes(_flipped(path.read_bytes(), bits))


def _any_file(folder, rng):
    """A file, each byte of the folder as likely as any other half of the time, else each file."""
    files = files_of(folder)
    sizes = np.array([path.stat().st_size for path in files], float)
    return rng.choice(files, p=0.5 * sizes / sizes.sum() + 0.5 / len(files))


def edited(change):
    """Damage to a file by a function of its bytes and the generator."""

    def damage(folder, other, rng):
        path = _any_file(folder, rng)
        path.write_bytes(change(path.read_bytes(), rng))
        return f"{change.__name__} in {path.name}"

    return damage


@edited
def one_bit(data, rng):
    return _flipped(data, [int(rng.integers(8 * len(data)))])


@edited
def zeros(data, rng):
    start = int(rng.integers(len(data))) if rng.integers(2) else 0
    return data[:start] + bytes(len(data) - start)


@edited
def cut(data, rng):
    return data[: int(rng.integers(len(data)))]


@edited
def longer(data, rng):
    return data + rng.bytes(int(rng.integers(1, 5000)))


@edited
def garbage(data, rng):
    return rng.bytes(len(data))


def many_bits(folder, other, rng):
    return ", ".join(one_bit(folder, other, rng) for _ in range(int(rng.integers(2, 9))))


def deleted(folder, other, rng):
    path = _any_file(folder, rng)
    path.unlink()
    return f"{path.name} deleted"


def _shards(folder):
    return sorted((folder / "pairs").iterdir())


def _sum_of(folder, path):
    return folder / "sha256" / f"{path.name}.sha256"


def exchanged(folder, other, rng):
    """Two shards change places, half of the time with their checksums rewritten to fit."""
    one, two = rng.choice(_shards(folder), 2, replace=False)
    first, second = one.read_bytes(), two.read_bytes()
    one.write_bytes(second)
    two.write_bytes(first)
    with_sums = bool(rng.integers(2))
    if with_sums:
        of_one, of_two = _sum_of(folder, one), _sum_of(folder, two)
        first, second = of_one.read_bytes(), of_two.read_bytes()
        of_one.write_bytes(second[:64] + first[64:])
        of_two.write_bytes(first[:64] + second[64:])
    return f"{one.name} and {two.name} exchanged{', with sums' * with_sums}"


def _stale(folder, other, path, with_sum):
    for each in (path, _sum_of(folder, path))[: 1 + with_sum]:
        shutil.copy(other / each.relative_to(folder), each)
    return f"{path.name} of another matrix{', with its sum' * with_sum}"


def stale(folder, other, rng):
    """A shard of another matrix, half of the time with its checksum."""
    return _stale(folder, other, rng.choice(_shards(folder)), bool(rng.integers(2)))


def stale_poses(folder, other, rng):
    """The poses of another matrix, with their checksum."""
    return _stale(folder, other, folder / "poses.npz", with_sum=True)


def one_too_many(folder, other, rng):
    """A shard beyond the last."""
    shards = _shards(folder)
    shutil.copy(shards[0], folder / "pairs" / f"pairs-{len(shards):05d}.npz")
    return "a shard too many"


KINDS = (
    *(one_bit, cut, longer, zeros, garbage),
    *(many_bits, deleted, exchanged, stale, stale_poses, one_too_many),
)


def verdict(folder, whole, matrix, build_arguments):
    """Fault of a damaged folder, empty if everything is as it must be.

    Reading it gives the right matrix or one `ConfigError`; building it again gives the right
    matrix, and every file as it was before the damage: `whole`, by `contents_of`.
    """
    try:
        if not _same(VisibilityMatrix.load(folder), matrix):
            return "read, and wrong"
    except ConfigError as error:
        if "\n" in str(error) or str(folder) not in str(error):
            return f"no clear line: {error}"
    again = build_matrix(**build_arguments, folder=folder, note=lambda line: None)
    if not _same(again, matrix) or not _same(VisibilityMatrix.load(folder), matrix):
        return "built again, and wrong"
    return "" if contents_of(folder) == whole else "built again, with other files"


def _same(one, other):
    of_one, of_other = (
        [each.header, each.task, *(getattr(each, name).tolist() for name in ARRAYS)]
        for each in (one, other)
    )
    return of_one == of_other


def campaign(base, build_arguments, other_poses, trials, seed=0):
    """Damage a matrix in every way, again and again: verdicts other than "" by what was done.

    `base` is an empty folder. The matrix has two shards or more, and the other one as many poses;
    each kind of damage is tried at least once.
    """
    quiet, other, folder = base / "quiet", base / "other", base / "damaged"
    matrix = build_matrix(**build_arguments, folder=quiet)
    build_matrix(**build_arguments | {"poses": other_poses}, folder=other)
    rng, wrong, whole = np.random.default_rng(seed), {}, contents_of(quiet)
    for trial in range(max(trials, len(KINDS))):
        shutil.copytree(quiet, folder)
        kind = KINDS[trial % len(KINDS)]
        what = kind(folder, other, rng)
        again = dict(build_arguments)
        if kind in (exchanged, stale, stale_poses, one_too_many) and rng.integers(2):
            del again["poses_a_shard"]  # the header knows it
        if result := verdict(folder, whole, matrix, again):
            wrong[f"trial {trial}, {what}"] = result
        shutil.rmtree(folder)
    return wrong
