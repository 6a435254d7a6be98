"""What a loss of power leaves: whatever was written and not forced to the disk is gone.

The calls of a replacement of results are recorded, and replayed up to each of them; then every file
whose data were not forced there is empty, as on file systems that write names before data.
"""

import os
import shutil

import pytest
from faults import Disk, Killed, calls_to

from steelyard.output import results_folder, settle, write_file

OLD = {"a": b"old a", "b": b"old b", "mine": b"mine"}
NEW = {"a": b"new a", "b": b"new b", "c": b"new c", "mine": b"mine"}


class VolatileDisk(Disk):
    """Keeps in mind which files hold data that are not on the disk yet, by what they are: names may
    change."""

    def __init__(self, at=None):
        super().__init__(at, "kill")
        self.unforced = set()

    def __call__(self, name, call, arguments, options):
        if name == "write":
            about = os.fstat(arguments[0])
            self.unforced.add((about.st_dev, about.st_ino))
        return super().__call__(name, call, arguments, options)

    def done(self, name, call, arguments, options):
        if name == "fsync":
            about = os.fstat(arguments[0])
            self.unforced.discard((about.st_dev, about.st_ino))
        return super().done(name, call, arguments, options)

    def lose_power(self, folder):
        for path in folder.rglob("*"):
            about = path.lstat()
            if path.is_file() and (about.st_dev, about.st_ino) in self.unforced:
                path.write_bytes(b"")


def tree(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if path.is_file()}


@pytest.mark.parametrize("shared", [False, True], ids=["exchanged", "name by name"])
def test_old_or_new_after_a_loss_of_power_at_every_call(tmp_path, shared):
    out = tmp_path / "out"

    def again(disk):
        shutil.rmtree(out, ignore_errors=True)
        for path in tmp_path.iterdir():
            shutil.rmtree(path) if path.is_dir() else path.unlink()
        out.mkdir()
        for name, content in OLD.items():
            (out / name).write_bytes(content)
        with calls_to(disk):
            try:
                with results_folder(out, force=True, shared=shared) as folder:
                    for name in "abc":
                        write_file(folder / name, NEW[name])
            except Killed:
                return

    again(whole := VolatileDisk())
    assert tree(out) == NEW
    # Data and names are there when it has ended.
    assert not whole.unforced
    ends = dict.fromkeys(("old", "new"), 0)
    for at in range(len(whole.calls)):
        again(lost := VolatileDisk(at))
        lost.lose_power(tmp_path)
        settle(out)
        found = tree(out)
        assert found in (OLD, NEW), (at, whole.calls[at], found)
        ends["old" if found == OLD else "new"] += 1
    assert min(ends.values()) > 0
    print(f"{len(whole.calls)} calls, {ends}")


def test_a_file_that_is_not_forced_to_the_disk_would_be_found(tmp_path):
    path = tmp_path / "a"
    with calls_to(disk := VolatileDisk()):
        file = os.open(path, os.O_CREAT | os.O_WRONLY)
        os.write(file, b"1")
        os.close(file)
    assert disk.unforced
    disk.lose_power(tmp_path)
    assert path.read_bytes() == b""
