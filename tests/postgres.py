"""A PostgreSQL of its own on the loopback address, for the time of a block."""

import os
import shutil
import socket
import subprocess
import tempfile
from contextlib import contextmanager
from pathlib import Path

USER = "steelyard"
OWNER = "postgres"
"""Who runs the server where the tests run as root, which it refuses."""


def programs():
    """Folder of its programs, the newest; None: it is not installed."""
    on_path = shutil.which("initdb")
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"), key=lambda p: p.parts[-3])
    return Path(on_path).parent if on_path else found[-1].parent if found else None


@contextmanager
def server():
    """Its URL without a database; everybody of this machine is trusted."""
    bin_ = programs()
    as_owner = ["runuser", "-u", OWNER, "--"] if os.geteuid() == 0 else []
    folder = Path(tempfile.mkdtemp(prefix="pg"))
    if as_owner:
        shutil.chown(folder, OWNER)
    data = str(folder / "data")

    def run(program, *words):
        subprocess.run(
            [*as_owner, bin_ / program, "-D", data, *words],
            check=True,
            cwd=folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    try:
        run("initdb", "-A", "trust", "-U", USER, "--no-sync")
        keys = f"-p {port} -c listen_addresses=127.0.0.1 -c fsync=off -k {folder}"
        run("pg_ctl", "-w", "-o", keys, "-l", str(folder / "log"), "start")
        try:
            yield f"postgresql://{USER}@127.0.0.1:{port}"
        finally:
            run("pg_ctl", "-m", "immediate", "stop")
    finally:
        shutil.rmtree(folder, ignore_errors=True)
