"""The process that reads logs: used again, ended after errors, with limits that are named."""

import os
import re
import signal
import threading

import log_files as files
import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.logs import fence
from steelyard.logs.formats import format_of, open_log


@pytest.fixture
def path(tmp_path):
    files.write_hdf5(tmp_path / "a.h5", files.streams())
    return tmp_path / "a.h5"


@pytest.fixture(autouse=True)
def no_process_before():
    fence._end_all()
    yield
    fence._end_all()


def force(path):
    with open_log(path, "cables") as log:
        return log.read(["t", "force[0]"])["force[0]"]


def test_one_process_reads_one_log_after_another(path):
    first = force(path)
    (reader,) = fence._idle
    np.testing.assert_array_equal(force(path), first)
    assert [*fence._idle] == [reader]


def test_messages_are_the_same_within_the_fence(tmp_path):
    files.write_mcap_json(tmp_path / "a.mcap", files.streams())
    opened = (open_log, format_of(tmp_path / "a.mcap").opened)
    found = []
    for each in opened:
        with each(tmp_path / "a.mcap", "imu") as log:
            found.append(log.read(["angular_velocity.x"])["angular_velocity.x"])
    np.testing.assert_array_equal(*found)


def test_a_process_that_met_a_damaged_file_reads_no_other(path, tmp_path):
    force(path)
    (tmp_path / "b.h5").write_bytes(path.read_bytes()[:3000])
    with pytest.raises(InputError, match="an HDF5 file"):
        force(tmp_path / "b.h5")
    assert not fence._idle
    assert len(force(path)) == 40


def test_a_process_that_was_killed_while_it_waited_is_replaced(path):
    force(path)
    fence._idle[0].process.kill()
    fence._idle[0].process.wait()
    assert len(force(path)) == 40


def test_a_process_that_ends_within_a_request_is_a_sentence(path):
    with open_log(path, "cables") as log:
        log.load.__self__.process.send_signal(signal.SIGXCPU)
        log.load.__self__.process.wait()
        with pytest.raises(InputError, match="takes more than 6 s of the processor"):
            log.read(["t"])


def test_memory_that_is_not_allowed_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv(fence.VARIABLE, "6,100")
    path = tmp_path / "a.h5"
    with files.h5py.File(path, "w") as file:
        file.create_dataset("x", shape=(8_000_000, 2), dtype="f8", chunks=(9999, 2))
    with pytest.raises(InputError, match="more than 100 MiB of memory"), open_log(path) as log:
        log.read(["x[0]", "x[1]"])


@pytest.mark.parametrize("text", ["6", "a,b", "0,5", "-1,5", "6,768,1"])
def test_limits_that_are_none(path, monkeypatch, text):
    monkeypatch.setenv(fence.VARIABLE, text)
    with pytest.raises(InputError, match=fence.VARIABLE):
        force(path)


@pytest.mark.integration
def test_the_option_says_the_same_for_one_command(tmp_path, run, monkeypatch):
    monkeypatch.delenv(fence.VARIABLE, raising=False)
    files.write_hdf5(tmp_path / "a.h5", files.streams())
    draft = ("init", tmp_path / "a.h5", "--robot", "cogiro", "--out", tmp_path / "experiment.yaml")
    status, _, err = run(*draft, "--limits", "6,1")
    assert status == 2
    assert "more than 1 MiB of memory" in err
    assert "--limits 60,2048" in err
    assert fence.VARIABLE not in os.environ
    assert run(*draft, "--limits", "60,2048")[0] == 0
    status, _, err = run(*draft, "--force", "--limits", "0,9")
    assert status == 2
    assert re.match(r"steelyard: --limits: expected seconds and MiB, .*found '0,9'", err)


def test_relative_paths_follow_the_working_folder(path, monkeypatch):
    force(path)
    monkeypatch.chdir(path.parent)
    assert len(force(type(path)("a.h5"))) == 40


def test_threads_have_a_process_each(path):
    found = []
    threads = [threading.Thread(target=lambda: found.append(force(path))) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 3
    assert len(fence._idle) <= 2


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
def test_a_forked_process_has_none_of_them(path):
    force(path)
    child = os.fork()
    if not child:
        os._exit(0 if not fence._idle else 1)
    assert os.waitpid(child, 0)[1] == 0
    assert len(force(path)) == 40
