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
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future
from contextlib import suppress
from queue import SimpleQueue
from types import MappingProxyType
from typing import Any

from rastercov.base.child import child_environment
from rastercov.base.closing import Closing
from rastercov.base.errors import RastercovError

PROGRAM = "from rastercov.cluster.process import serve; serve()"
EMPTY: Mapping[str, str] = MappingProxyType({})


class ProcessEndedError(Exception):
    """The process that was to answer has ended; the message says how.

    Attributes
    ----------
    was_killed : bool
        True for a signal, False where it ended by itself.
    """

    def __init__(self, code: int) -> None:
        self.was_killed = code < 0
        name = signal.Signals(-code).name if self.was_killed else ""
        super().__init__(f"was killed by {name}" if name else f"ended with code {code}")


class Process(Closing):
    """A Python process with the modules of this one, from the installed package."""

    def __init__(self, environment: Mapping[str, str] = EMPTY) -> None:
        # A session of its own: Ctrl-C is for this process, which then ends the other.
        self._child = subprocess.Popen(
            [sys.executable, "-c", PROGRAM], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            env={**child_environment(), **environment}, start_new_session=True,
        )  # fmt: skip

    def call(self, function: Callable[..., Any], *arguments: Any) -> Any:
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


class Answer(Future[Any]):
    """Outcome of a call, as `distributed.Future`, as far as `run` uses that."""

    def __init__(self, key: str, call: tuple[Any, ...]) -> None:
        super().__init__()
        self.key, self.call = key, call

    @property
    def status(self) -> str:
        """One of "pending", "cancelled", "error" and "finished"."""
        if not self.done():
            return "pending"
        return "cancelled" if self.cancelled() else "error" if self.exception() else "finished"


class Processes(Closing):
    """Some processes of this machine, as `distributed.Client`, as far as `run` uses that.

    A process that has ended is replaced when there is more to do.
    """

    status = "running"

    def __init__(self, number: int, environment: Mapping[str, str]) -> None:
        self._number, self._environment = number, environment
        self._asked: SimpleQueue[Answer | None] = SimpleQueue()
        self._lock, self._running, self._is_closed = threading.Lock(), set[Process](), False
        self._threads = [threading.Thread(target=self._serve, daemon=True) for _ in range(number)]
        for thread in self._threads:
            thread.start()

    def submit(self, *call: Any, key: str, pure: bool) -> Answer:
        """Answer of a function and its arguments, which are called once."""
        answer = Answer(key, call)
        self._asked.put(answer)
        return answer

    def nthreads(self) -> dict[str, int]:
        """Threads of all processes, one each."""
        return {"this machine": self._number}

    def cancel(self, answers: Iterable[Answer]) -> None:
        """Call nothing of these that has not begun."""
        for answer in answers:
            answer.cancel()

    def close(self) -> None:
        """Kill all processes."""
        with self._lock:
            self._is_closed = True
            for process in self._running:
                process.close()
        for _ in self._threads:
            self._asked.put(None)
        for thread in self._threads:
            thread.join()

    def _serve(self) -> None:
        """One process after the other, in a thread."""
        process = None
        while (answer := self._asked.get()) is not None:
            if not answer.set_running_or_notify_cancel():
                continue
            try:
                process = process or self._started()
                answer.set_result(process.call(*answer.call))
            except ProcessEndedError as error:
                self._forget(process)
                process = None
                answer.set_exception(error)
            except Exception as error:
                answer.set_exception(error)

    def _started(self) -> Process:
        with self._lock:
            if self._is_closed:
                raise ProcessEndedError(-signal.SIGKILL)
            process = Process(self._environment)
            self._running.add(process)
            return process

    def _forget(self, process: Process | None) -> None:
        with self._lock:
            if process is not None and not self._is_closed:
                process.close()
                self._running.remove(process)


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
