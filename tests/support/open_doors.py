"""Doors that the processes of a run leave open to the other users of the machine."""

import re
import subprocess
from pathlib import Path

NOBODY = "65534"
LISTENING = "0A"
"""State of a TCP socket in /proc."""
ACCEPTS = 0x10000
"""Flag of a Unix socket in /proc that accepts connections."""
ATTEMPT = """
import os, sys
for path in sys.argv[1:]:
    try:
        os.close(os.open(path, os.O_WRONLY | os.O_NONBLOCK))
        print(path)
    except OSError:
        pass
"""


def family(pid):
    """A process and all that it has started, directly or not."""
    above = {}
    for entry in Path("/proc").glob("[0-9]*/stat"):
        try:
            above[int(entry.parent.name)] = int(entry.read_text().rpartition(")")[2].split()[1])
        except OSError:  # it has ended
            continue
    items = {pid}
    while more := {one for one, parent in above.items() if parent in items} - items:
        items |= more
    return items


def listening(pids):
    """Addresses at which processes accept connections: TCP, UDP and Unix sockets."""
    own = set()
    for pid in pids:
        for entry in Path(f"/proc/{pid}/fd").glob("*"):
            try:
                own |= set(re.findall(r"socket:\[(\d+)\]", str(entry.readlink())))
            except OSError:  # closed, or ended
                continue
    items = []
    for kind in ("tcp", "tcp6", "udp", "udp6"):
        for line in _lines(f"/proc/net/{kind}"):
            words = line.split()
            if words[9] in own and (words[3] == LISTENING or kind.startswith("udp")):
                items.append(f"{kind} {words[1]}")
    for line in _lines("/proc/net/unix"):
        words = line.split()
        if words[6] in own and int(words[3], 16) & ACCEPTS:
            items.append(f"unix {words[7:]}")
    return items


def opened_by_others(pids):
    """Standard streams of processes that another user can write to, from which they take calls."""
    paths = [f"/proc/{pid}/fd/{number}" for pid in pids for number in range(8)]
    words = ["setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups"]
    program = ["/usr/bin/python3", "-c", ATTEMPT]
    done = subprocess.run([*words, *program, *paths], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def _lines(path):
    return Path(path).read_text().splitlines()[1:] if Path(path).exists() else []
