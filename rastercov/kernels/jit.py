"""Compilation of loops by numba: without a lock, kept on disk, with a notice the first time.

A result on disk is used only while the file of the loop, and all files of the package that it
imports, directly or not, have the content that it was compiled from.

numba compiles in one thread of a process at a time; a fork waits until it is done.

A process that needs a loop which another one compiles waits for it.

A disk may be full, read-only or damaged. A file is used only if its hash is right and it was made
from this source for these arguments; otherwise the loop is compiled again. A result that cannot be
written is not kept, and one notice per process says so.
"""

import fcntl
import functools
import hashlib
import inspect
import logging
import os
import pickle
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import IO, Any

import numba
from numba.core import caching, types
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher as _Dispatcher
from numba.core.runtime.nrt import rtsys
from numba.core.serialize import dumps
from numba.core.targetconfig import ConfigStack
from numba.extending import overload

from rastercov.kernels import compiler
from rastercov.kernels.compiler import LoopCompiler, LoopFlags, PartCompiler
from rastercov.kernels.stopwatch import Stopwatch

# A process forked while another thread compiles would find the compiler locked for ever, in the
# middle of a loop; releasing the lock there would not be safe.
os.register_at_fork(
    before=global_compiler_lock.acquire,
    after_in_parent=global_compiler_lock.release,
    after_in_child=global_compiler_lock.release,
)

LOG = logging.getLogger("rastercov")
"""Notices of the library, at level WARNING, which Python shows on standard error unless the program
configures logging: half a minute of compilation without a notice looks like a hang."""
LARGEST_LOOP = 64 << 20
"""Bytes of one compiled loop on disk; real ones have less than one MiB."""
ROOM = 8 << 20
"""Bytes that all compiled loops need on disk, and a little more."""
FIRST_START = 7500.0
"""Time in which two processes compile all loops of a first start, relative to that of a short sum
in Python."""
LONGEST_WAIT_S = 300.0
"""Seconds after which a loop is compiled here, too, although another process has begun it; one that
is stopped never ends."""
CODE_SETTINGS = (
    "BOUNDSCHECK", "CPU_FEATURES", "CPU_NAME", "DEBUGINFO_DEFAULT", "ENABLE_AVX", "LOOP_VECTORIZE",
    "OPT", "SLP_VECTORIZE",
)  # fmt: skip
UNUSED_S = 14 * 24 * 3600
"""Seconds after which loops that no process has loaded are removed."""

_said: dict[str, object] = {}


class _CheckedFile(caching.IndexDataCacheFile):
    """Files of one compiled loop: an index and a file for each signature, each with its hash.

    A file also names the source and the signature that it was made for. numba replaces its two
    files one after the other, so a full disk, or two processes at once, can leave an index that
    refers to the result of an older source.
    """

    def load(self, key: Any) -> Any:
        """Return the result for a signature, None if there is none that can be trusted."""
        name = self._load_index().get(key)
        found = self._read(name) if name is not None else None
        if not isinstance(found, tuple) or found[:2] != self._made_for(key):
            return None
        return found[2]

    def save(self, key: Any, data: Any) -> None:
        super().save(key, (*self._made_for(key), data))

    def _made_for(self, key: Any) -> tuple[Any, str]:
        return self._source_stamp, repr(key)

    def _load_index(self) -> dict[Any, str]:
        found = self._read(self._index_name)
        if not isinstance(found, tuple) or found[:2] != (self._version, self._source_stamp):
            return {}
        names: dict[Any, str] = found[2]
        return names

    def _save_index(self, overloads: dict[Any, str]) -> None:
        self._write(self._index_name, (self._version, self._source_stamp, overloads))

    def _save_data(self, name: str, data: Any) -> None:
        self._write(name, data)

    def _write(self, name: str, content: Any) -> None:
        data = dumps(content)
        with self._open_for_write(self._data_path(name)) as file:
            file.write(hashlib.sha256(data).digest() + data)

    def _read(self, name: str) -> Any:
        """Content of a file, None if it is missing, truncated or of another program.

        What another version left may name types that are gone.
        """
        try:
            path = Path(self._data_path(name))
            if not path.is_file() or path.stat().st_size > LARGEST_LOOP:
                return None
            data = path.read_bytes()
        except OSError:
            return None
        digest, data = data[:32], data[32:]
        if hashlib.sha256(data).digest() != digest:
            return None
        try:
            return pickle.loads(data)
        except Exception:
            return None


@cache
def _loops_folder(named: str | None) -> Path | None:
    """Folder of this user for all compiled loops, None if none can be trusted and written.

    A loop is machine code: a folder that somebody else may write, or that belongs to somebody else
    (HOME kept by sudo), is not used.
    """
    # Without HOME, and for a user without an entry, the latter is the relative path "~/.cache".
    own = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser())
    folder = Path(named) if named else own / "rastercov" / "loops"
    if not named and not folder.is_absolute():
        return None
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.stat()
        if not named and (status.st_uid != os.geteuid() or status.st_mode & 0o022):
            return None
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return None
    return folder


class _UserFolder(caching._CacheLocator):
    """Folder of a module's loops, named after the digest of its sources and of numba's settings.

    Another checkout with the same sources, a worker, or a run of the tests finds them there.
    """

    def __init__(self, folder: Path, function: Callable[..., Any]) -> None:
        self._line = function.__code__.co_firstlineno
        self._stamp = _source_digest(Path(function.__code__.co_filename))
        made_by = f"{self._stamp} {_settings()}"
        self._folder = folder / hashlib.sha256(made_by.encode()).hexdigest()[:32]

    @classmethod
    def from_function(cls, function: Callable[..., Any], path: str) -> "_UserFolder | None":
        """Return the folder of a loop, None if no folder of this user can be written."""
        folder = _loops_folder(os.environ.get("NUMBA_CACHE_DIR"))
        return cls(folder, function) if folder and Path(path).exists() else None

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        return self._stamp

    def get_disambiguator(self) -> str:
        return str(self._line)


@cache
def _settings() -> list[str]:
    """Settings of numba, from the environment or a file, that may make other machine code."""
    return [f"{name}={getattr(numba.config, name, None)}" for name in CODE_SETTINGS]


def _drop_unused(folder: Path) -> None:
    """Remove loops of sources that no process has loaded for `UNUSED_S`."""
    limit = time.time() - UNUSED_S
    for path in folder.iterdir():
        if re.fullmatch("[0-9a-f]{32}", path.name) and path.stat().st_mtime < limit:
            shutil.rmtree(path, ignore_errors=True)


@cache
def _touch(folder: str) -> None:
    """Mark a folder of loops as used, once per process."""
    with suppress(OSError):
        os.utime(folder)


class _Place(caching.CompileResultCacheImpl):
    """Folders in which a loop may be kept: that of the user, else the one beside its source."""

    @property
    def _locator_classes(self) -> list[Any]:  # type: ignore[override] # numba has an attribute
        return [_UserFolder, caching.InTreeCacheLocator]


class _Kept(caching.FunctionCache):
    """A loop on disk; without a disk, loops are compiled in each process."""

    _impl_class = _Place
    is_writable = True
    """Of all loops; False from the first failure on, as the next would fail alike."""
    _held: IO[bytes] | None = None
    """File that this process has locked while it compiles the loop."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        digest = _source_digest(Path(function.__code__.co_filename))
        self._cache_file = _CheckedFile(self.cache_path, self._impl.filename_base, digest)

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Return the loop on disk, None if there is none: numba then compiles it."""
        found = self._load(signature, context)
        if found is None and self._begin():
            found = self._load(signature, context)
        if found is None:
            self._announce()
        return found

    def _load(self, signature: Any, context: Any) -> Any:
        """Return the loop on disk.

        numba would first load its rules of all functions, and scipy for some of them, half a
        second; only compilation needs them. A loop that runs needs its memory management alone.
        """
        try:
            rtsys.initialize(context)
            found = self._load_overload(signature, context)
            _touch(self.cache_path)
            return found
        except Exception:  # whatever LLVM makes of what another version of it left
            return None

    def _begin(self) -> bool:
        """Lock the loop, which no other process then compiles; True if one did until now."""
        if self._held is not None or not _Kept.is_writable:
            return False
        try:
            self._impl.locator.ensure_cache_path()
            path = Path(self.cache_path, f"{self._impl.filename_base}.lock")
            self._held = path.open("ab")  # `end` closes it
            began = time.monotonic()
            while not _locked(self._held) and time.monotonic() < began + LONGEST_WAIT_S:
                _say_once("compiling", "rastercov: compiling in another process; waiting for it")
                time.sleep(0.05)
        except OSError:  # no room, or a file system without locks
            return False
        return True

    def end(self) -> None:
        """Unlock the loop."""
        if self._held is not None:
            self._held.close()
            self._held = None

    def save_overload(self, signature: Any, data: Any) -> None:
        if not _Kept.is_writable:
            return
        try:
            super().save_overload(signature, data)
        except OSError as error:
            self.give_up(error)

    def holds_any(self) -> bool:
        """True if an earlier run left this loop here, compiled from the same source."""
        return bool(self._cache_file._load_index())

    def _announce(self) -> None:
        if "compiling" not in _said and self.has_room():
            _say_once("compiling", "rastercov: compiling some loops, once for this version")

    def has_room(self) -> bool:
        """True if the folder has room for all loops; if not, nothing is kept."""
        if _Kept.is_writable:
            try:
                self._impl.locator.ensure_cache_path()
                if isinstance(self._impl.locator, _UserFolder):
                    _drop_unused(Path(self.cache_path).parent)
                with tempfile.TemporaryFile(dir=self.cache_path) as file:
                    file.write(bytes(ROOM))
            except OSError as error:
                self.give_up(error)
        return _Kept.is_writable

    def give_up(self, error: OSError) -> None:
        """Keep nothing more on disk in this process, and give notice of the reason."""
        _Kept.is_writable = False
        _say_unkept(f"{self.cache_path}: {error.strerror or error}")


def _locked(file: IO[bytes]) -> bool:
    """Lock a file, which a process that ends unlocks; False if another one has locked it."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


class _Unkept(caching.NullCache):
    """No place for a loop."""

    def load_overload(self, signature: Any, context: Any) -> None:
        _say_unkept("no folder for it can be written")

    def end(self) -> None:
        """Unlock nothing."""


class _Loop(_Dispatcher):
    """Loop that Python calls; a `Stopwatch` does not count the time in which it is compiled."""

    _cache: Any

    def compile(self, signature: Any) -> Any:
        with uncounted():
            try:
                return super().compile(signature)
            finally:
                self._cache.end()


@contextmanager
def uncounted() -> Iterator[None]:
    """Stop all stopwatches, while this thread compiles and no other one may."""
    with global_compiler_lock:
        before, began = Stopwatch.left_out, time.perf_counter()
        try:
            yield
        finally:
            # Blocks inside this one have added their parts of it to what was `before`.
            Stopwatch.left_out = before + time.perf_counter() - began


_IMPORT = re.compile(
    r"^from ([\w.]+) import (\([^)]*\)|[^\n]*)|^import ([\w.]+)", flags=re.MULTILINE
)


@cache
def _read_module(path: Path) -> tuple[bytes, tuple[Path, ...]]:
    """SHA-256 of a module file, and the files that it imports from its own top-level package.

    A module in no package, such as a test, is taken as one of this package. Recognised are absolute
    imports that start in the first column.
    """
    source = path.read_bytes()
    folder = path.parent
    while (folder / "__init__.py").exists():
        folder = folder.parent
    if folder == path.parent:
        folder, package = Path(__file__).parents[2], "rastercov"
    else:
        package = path.relative_to(folder).parts[0]
    files = []
    for parent, names, module in _IMPORT.findall(source.decode()):
        parts = (parent or module).split(".")
        if parts[0] != package:
            continue
        target = folder.joinpath(*parts)
        found = [target / f"{name.split()[0]}.py" for name in re.findall(r"\w[\w ]*", names)]
        if not found or not all(file.exists() for file in found):
            found += [target.with_suffix(".py"), target / "__init__.py"]
        files += [file for file in found if file.exists()]
    return hashlib.sha256(source).digest(), tuple(files)


@cache
def _source_digest(path: Path) -> str:
    """SHA-256 of a module file and of all that it imports, directly or not, from its package.

    numba itself stamps a loop with its own file only, and would run what is on disk although a
    function or a constant from another file has changed. Imports of this module are not followed.
    """
    digests: dict[Path, bytes] = {}
    waiting = [path, Path(compiler.__file__)]
    while waiting:
        file = waiting.pop()
        if file not in digests:
            digests[file], imports = _read_module(file)
            waiting += imports if file != Path(__file__) else ()
    return hashlib.sha256(b"".join(digests[file] for file in sorted(digests))).hexdigest()


def compiled(function: Callable[..., Any]) -> Any:
    """Compile on first use and keep the result on disk, if a folder can be written."""
    return _kept(function)


def allocation_free(function: Callable[..., Any]) -> Any:
    """Compile as `compiled`, without reference counts: for loops that allocate no arrays.

    numba counts a reference to every array that is read from a named tuple or passed on, by an
    atomic operation; in the kernels of `rastercov.exact` that took a third of the time.
    """
    return _kept(function, _nrt=False)


def called_whole(function: Callable[..., Any]) -> Any:
    """Compile as `allocation_free`, and leave it a function in the loops that call it.

    For much code that a loop does not need for each face, or for each face once: LLVM copies it to
    each place that calls it, and optimises the copies with what is around them. The loop that
    judges faces took 121 CPU-s to compile through a lens, and takes 4.
    """
    # A mark that the compiler looks for; the type of a function has no field for it.
    function.is_called_whole = True  # type: ignore[attr-defined]
    return allocation_free(function)


def _kept(function: Callable[..., Any], **options: Any) -> Any:
    loop = _for_any_integer(function, **options)
    loop.__class__ = _Loop
    try:
        loop._cache = _Kept(function)
    except (RuntimeError, OSError):  # nowhere to write: compile in every process
        loop._cache = _Unkept()
    return loop


def _for_any_integer(function: Callable[..., Any], **options: Any) -> Any:
    """Compile a function once for all integers that other loops give it.

    numba would compile it again for each constant, and for 32 and 64 bits. No C program calls it.
    """
    # What is not said of inlining here, a function takes over from the part that calls it.
    options = {
        "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True, "forceinline": False,
        **options,
    }  # fmt: skip
    loop: Any = numba.njit(**{"pipeline_class": LoopCompiler, **options})(function)
    template = loop.get_call_template

    def template_of_widened(args: Any, kws: Any) -> Any:
        _check_caller(function.__name__, args)
        widened = {name: _widened(kind) for name, kind in dict(kws).items()}
        return template(tuple(map(_widened, args)), widened)

    loop.get_call_template = template_of_widened
    return loop


def _check_caller(name: str, kinds: Any) -> None:
    """Accept a call by a loop that passes named tuples as `LoopCompiler` does."""
    flags = ConfigStack.top_or_none()
    is_known = flags is None or isinstance(flags, LoopFlags)
    if not is_known and any(isinstance(kind, types.NamedTuple) for kind in kinds):
        raise TypeError(f"{name} takes a named tuple; call it from a loop of rastercov.kernels.jit")


def _widened(kind: Any) -> Any:
    """Type of an argument, without its value; 64 bits for a signed integer."""
    kind = types.unliteral(kind)
    return types.int64 if kind in types.signed_domain else kind


class _Part(_Dispatcher):
    """Function that is compiled into the loops that call it, without a wrapper for Python.

    A wrapper would contain the function once more, and take as long to compile. Where Python does
    call the function, it is compiled by itself.
    """

    _alone: Any = None

    def __call__(self, *args: Any, **kws: Any) -> Any:
        if self._alone is None:
            self._alone = _for_any_integer(self.py_func)
        return self._alone(*args, **kws)


def _part(function: Callable[..., Any], **options: Any) -> Any:
    options = {"forceinline": True, "no_cpython_wrapper": True, **options}
    loop = _for_any_integer(function, pipeline_class=PartCompiler, **options)
    loop.__class__ = _Part
    return loop


def part_of(function: Callable[..., Any]) -> Any:
    """Compile into the loop that calls it, by LLVM: for small functions that are called often.

    It must not take arrays, whose references would be counted at each call.
    """
    return _part(function)


def part_with_arrays(function: Callable[..., Any]) -> Any:
    """Compile into the loop that calls it, as `part_of`, without reference counts.

    For loops that are `allocation_free`, too. numba's `inline="always"` makes the same code, but it
    copies the whole function for each call, and all its variables for each block of it: the loops
    of `rastercov.exact` took twice as long to compile.
    """
    return _part(function, _nrt=False)


def by_type(argument: str, kind: type, other: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function as `part_with_arrays`, or `other` where an argument is of some type.

    The type of the argument is a NamedTuple, and the choice is made when a loop is compiled. Both
    functions have the same arguments and can be called in compiled loops only.
    """

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        names = list(inspect.signature(function).parameters)
        at = names.index(argument)

        def chosen(*types: Any) -> Callable[..., Any]:
            is_other = getattr(types[at], "instance_class", None) is kind
            return other if is_other else function

        def stub(*arguments: Any) -> Any:
            raise TypeError(f"{function.__name__} is for compiled loops")

        functools.update_wrapper(stub, function)
        options: Any = {
            "forceinline": True, "_nrt": False, "nogil": True, "error_model": "numpy",
            "no_cpython_wrapper": True, "no_cfunc_wrapper": True, "pipeline_class": PartCompiler,
        }  # fmt: skip
        overload(stub, jit_options=options, strict=False)(chosen)
        return stub

    return decorate


def is_compiled(loop: Any) -> bool:
    """True if a loop need not be compiled: this process has it, or the disk for this source."""
    cache = loop._cache
    return bool(loop.signatures) or (isinstance(cache, _Kept) and cache.holds_any())


def _say_unkept(why: str) -> None:
    _say_once(
        "unkept",
        "rastercov: compiling, in every process: the result cannot be kept on disk "
        f"({why}); set NUMBA_CACHE_DIR to a folder with room",
    )


def _say_once(kind: str, text: str) -> None:
    mine = object()  # whichever thread puts its own in says it; a lock might be held in a fork
    if _said.setdefault(kind, mine) is mine:
        LOG.warning("%s", text)


@contextmanager
def compiled_aside(module: str, function: str, loop: Any) -> Iterator[None]:
    """Call a function that compiles some loops in another process, while the block compiles others.

    numba compiles one loop at a time in a process; the results of both on disk are shared. If the
    other process fails, this one compiles its loops when it needs them. Where nothing can be kept,
    there is no other process.

    Parameters
    ----------
    module, function : str
        Function without arguments, and its module.
    loop : Any
        One of the loops.
    """
    if not (isinstance(loop._cache, _Kept) and loop._cache.has_room()):
        yield
        return
    about = _seconds_of_first_start()
    _say_once("compiling", f"rastercov: compiling, about {about:.0f} s, once for this version")
    aside, began = None, time.perf_counter()
    with suppress(OSError):
        aside = subprocess.Popen(
            # -P: no modules from the working directory
            [sys.executable, "-P", "-c", f"from {module} import {function} as run; run()"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
    try:
        with uncounted():
            yield
            if aside:
                aside.wait()
        LOG.warning("rastercov: compiled in %.0f s", time.perf_counter() - began)
    finally:
        if aside and aside.poll() is None:
            aside.kill()
            aside.wait()


def _seconds_of_first_start() -> float:
    """Seconds that all loops of a first start take, from the speed of Python on this machine."""
    began = time.process_time()
    sum(number * number for number in range(100_000))
    seconds = FIRST_START * (time.process_time() - began)
    return max(10.0, 10 * round(seconds / 10)) * (1 if len(os.sched_getaffinity(0)) > 1 else 2)
