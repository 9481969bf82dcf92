"""Processes of this machine that call functions for this one, and listen nowhere.

Each has a pair of pipes to the process that started it, and ends with it. No other user can reach
it, whereas a socket of the machine serves all of its users.
"""

import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from queue import SimpleQueue
from types import MappingProxyType
from typing import Any

from rastercov.base import Closing, RastercovError
from rastercov.base.threads import child_environment

PROGRAM = "from rastercov.shards.process import serve; serve()"
WINDOWS_ERRORS = 0xC0000000
"""Exit codes from here on are exceptions that ended a process on Windows."""
EMPTY: Mapping[str, str] = MappingProxyType({})


class ProcessEndedError(Exception):
    """The process that was to answer has ended; the message says how.

    Attributes
    ----------
    was_killed : bool
        True for a signal or an exception of Windows, False where it ended by itself.
    """

    def __init__(self, code: int) -> None:
        self.was_killed = not 0 <= code < WINDOWS_ERRORS
        words = f"ended with code {code}" if code < WINDOWS_ERRORS else f"crashed with {code:#x}"
        super().__init__(f"was killed by {signal.Signals(-code).name}" if code < 0 else words)


class Process(Closing):
    """A Python process with the modules of this one, from the installed package."""

    def __init__(self, environment: Mapping[str, str] = EMPTY) -> None:
        self.has_ended = False
        # A session of its own: Ctrl-C is for this process, which then ends the other.
        self._child = subprocess.Popen(
            [sys.executable, "-c", PROGRAM],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**child_environment(), **environment},
            start_new_session=True,
            creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),  # on Windows
        )

    def call(self, function: Callable[..., Any], *arguments: object) -> Any:
        """Result of a function of a module.

        Raises
        ------
        ProcessEndedError
            Where the process ends before it answers.
        Exception
            As the function raises it.
        """
        assert self._child.stdin is not None
        assert self._child.stdout is not None
        try:
            pickle.dump((function, arguments), self._child.stdin)
            self._child.stdin.flush()
            has_failed, outcome = pickle.load(self._child.stdout)
        except (OSError, EOFError, pickle.UnpicklingError):
            self.has_ended = True
            with suppress(OSError):
                self._child.stdin.close()  # it ends with its input
            raise ProcessEndedError(self._child.wait()) from None
        if has_failed:
            raise outcome
        return outcome

    def close(self) -> None:
        """Kill it."""
        self._child.kill()
        self._child.wait()
        for pipe in (self._child.stdin, self._child.stdout):
            with suppress(OSError):  # a call that it has not read
                pipe.close()  # type: ignore[union-attr] # there is one


class Processes(Closing):
    """Some processes of this machine. One that has ended is replaced when there is more to do."""

    def __init__(self, number: int, environment: Mapping[str, str]) -> None:
        self._number, self._environment = number, environment
        self._threads = ThreadPoolExecutor(number)
        self._lock, self._is_closed = threading.Lock(), False
        self._all, self._free = set[Process](), list[Process]()

    def submit(self, function: Callable[..., Any], *arguments: object) -> Future[Any]:
        """Outcome of a call, as by `Process.call`."""
        return self._threads.submit(self._call, function, *arguments)

    def result(self, future: Future[Any]) -> Any:
        """Result of a call that is done."""
        return future.result()

    def is_end(self, error: Exception) -> bool:
        """True for the error of a call whose process ended."""
        return isinstance(error, ProcessEndedError)

    def n_threads(self) -> int:
        """Calls that are made at a time."""
        return self._number

    def close(self) -> None:
        """Kill all processes."""
        with self._lock:
            self._is_closed = True
            for process in self._all:
                process.close()
        self._threads.shutdown(cancel_futures=True)

    def _call(self, function: Callable[..., Any], *arguments: object) -> Any:
        with self._lock:
            if self._is_closed:
                raise ProcessEndedError(-signal.SIGTERM)
            process = self._free.pop() if self._free else Process(self._environment)
            self._all.add(process)
        try:
            return process.call(function, *arguments)
        finally:
            with self._lock:
                if process.has_ended and not self._is_closed:
                    process.close()
                    self._all.remove(process)
                elif not process.has_ended:
                    self._free.append(process)


def serve() -> None:
    """Call what comes through standard input, and answer on what was standard output."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print
    asked: SimpleQueue[Any] = SimpleQueue()
    threading.Thread(target=_read, args=(asked,), daemon=True).start()
    while True:
        function, arguments = asked.get()
        try:
            outcome = False, function(*arguments)
        except Exception as error:
            outcome = True, _sendable(error)
        pickle.dump(outcome, answers)
        answers.flush()


def _read(asked: "SimpleQueue[Any]") -> None:
    """End this process with the one that asks, at once, whatever it is at."""
    try:
        while True:
            asked.put(pickle.load(sys.stdin.buffer))
    finally:
        os._exit(1)


def _sendable(error: Exception) -> Exception:
    """An error that is the same on the other end of a pipe."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # its class takes other arguments
        kind = "" if isinstance(error, RastercovError) else f"{type(error).__name__}: "
        return RastercovError(f"{kind}{error}")
    return error
