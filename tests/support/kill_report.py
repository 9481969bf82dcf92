"""Write a report and be killed before each of its file operations: python kill_report.py FOLDER.

A folder holds a report and a file of somebody else. A process that puts another report there ends
without a word before its first operation on a file, another before its second, and so on until
one comes to its end. Each folder is looked at as the kill left it, and again after a run that does
nothing but open it. Where a swap is on record, such a run is killed at each of its operations, too.
Prints one line of JSON: how many folders were found in each state.
"""

import json
import os
import re
import shutil
import sys
from collections import Counter
from hashlib import sha256
from pathlib import Path

from rastercov.report.folder import STAGING, ReportFolder, ReportKind

KIND = ReportKind("kind", re.compile(r"\w+\.txt"), last="last.txt")
REPORTS = {
    "old": {"a.txt": b"1", "b.txt": b"11", "last.txt": b"1 says it"},
    "new": {"b.txt": b"2", "z.txt": b"222", "last.txt": b"2 says it"},
}
MINE = b"mine"


def write(folder, report):
    """Put a report into a folder."""
    with ReportFolder(folder, KIND) as out:
        for name, data in REPORTS[report].items():
            out.file(name).write_bytes(data)
        out.publish()


def only_open(folder):
    """Do what the next command does before its work."""
    with ReportFolder(folder, KIND):
        pass


def killed(number, work, *arguments):
    """True if `work` was ended, in a process that ends before its file operation `number`."""
    process = os.fork()
    if process:
        return os.waitpid(process, 0)[1] != 0
    left = number

    def count(event, _):
        nonlocal left
        if event == "open" or event.startswith("os."):
            left -= 1
            if not left:
                os._exit(9)

    sys.addaudithook(count)
    work(*arguments)
    os._exit(0)


def state(folder):
    """The report that is whole in a folder; "incomplete" for one without its last file.

    Whole is one whose manifest lists these files with their hashes, and no others.
    """
    table = {path.name: path.read_bytes() for path in folder.glob("*.txt")}
    assert (folder / "notes.md").read_bytes() == MINE
    listed = json.loads((folder / KIND.manifest).read_bytes())["files"]
    is_listed = {name: entry["sha256"] for name, entry in listed.items()} == {
        name: sha256(data).hexdigest() for name, data in table.items()
    }
    for name, files in REPORTS.items():
        if table == files and is_listed:
            return name
    is_part = any(table.items() <= files.items() for files in REPORTS.values())
    return "incomplete" if "last.txt" not in table and is_part else "torn"


def open_and_look(folder, after):
    """Open a folder in peace, and count its state; it has nothing left of killed runs then."""
    only_open(folder)
    assert not (folder / STAGING).exists()
    after[state(folder)] += 1


def main():
    base = Path(sys.argv[1])
    with_old, folder, kept = base / "with_old", base / "folder", base / "kept"
    write(with_old, "old")
    (with_old / "notes.md").write_bytes(MINE)
    states, after = Counter(), Counter()
    number = 0
    while True:
        number += 1
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(with_old, folder)
        was_killed = killed(number, write, folder, "new")
        states[state(folder)] += 1
        shutil.rmtree(kept, ignore_errors=True)
        shutil.copytree(folder, kept)
        again = 0
        while (kept / STAGING / KIND.manifest).exists():
            again += 1
            if not killed(again, only_open, folder):
                break
            states[state(folder)] += 1
            open_and_look(folder, after)
            shutil.rmtree(folder)
            shutil.copytree(kept, folder)
        open_and_look(folder, after)
        if not was_killed:
            break
    print(json.dumps({"killed": states, "after": after, "kills": number - 1}))


if __name__ == "__main__":
    main()
