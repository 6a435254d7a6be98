"""Results reach their place whole or not at all."""

import math
import os
import signal
import sys
from pathlib import Path

import pytest
from time_limits import finished

from steelyard.errors import InputError
from steelyard.output import (
    check_target,
    disk,
    placing,
    results_folder,
    settle,
    to_json,
    write_json,
)


def fill(folder, **files):
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (folder / name).write_text(text)


def tree(folder):
    """Every path below a folder, with the text of its files."""
    return {
        str(p.relative_to(folder)): p.read_text() if p.is_file() else None
        for p in sorted(folder.rglob("*"))
    }


def publish(target, *, force=False, **files):
    with results_folder(target, force=force) as folder:
        fill(folder, **files)


def interrupt(target, error, *, force=False, **files):
    """Begin to publish, and fail."""
    with results_folder(target, force=force) as folder:
        fill(folder, **files)
        raise error


# Without an error


@pytest.mark.parametrize("force", [False, True])
def test_results_appear_at_the_end(tmp_path, force):
    target = tmp_path / "out"
    with results_folder(target, force=force) as folder:
        fill(folder, a="1")
        fill(folder / "inner", b="2")
        assert not target.exists()
    assert tree(tmp_path) == {"out": None, "out/a": "1", "out/inner": None, "out/inner/b": "2"}


def test_parents_are_made(tmp_path):
    publish(tmp_path / "x" / "y" / "out", a="1")
    assert tree(tmp_path) == {"x": None, "x/y": None, "x/y/out": None, "x/y/out/a": "1"}


def test_an_empty_folder_is_as_good_as_none(tmp_path):
    (tmp_path / "out").mkdir()
    publish(tmp_path / "out", a="1")
    assert tree(tmp_path) == {"out": None, "out/a": "1"}


def test_a_relative_path_stands_where_the_process_was_started(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    publish(Path("out"), a="1")
    assert tree(tmp_path) == {"out": None, "out/a": "1"}


def test_the_folder_one_stands_in_is_a_good_place(tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    publish(Path(), a="1")
    # Not only under its path: a shell that stands in it must see the results.
    assert os.listdir() == ["a"]
    assert tree(tmp_path) == {"here": None, "here/a": "1"}


def test_results_may_be_read_by_whoever_may_read_new_files(tmp_path):
    publish(tmp_path / "out", a="1")
    (tmp_path / "usual").mkdir()
    assert (tmp_path / "out").stat().st_mode == (tmp_path / "usual").stat().st_mode


# With an error


@pytest.mark.parametrize("error", [ValueError, OSError, InputError, KeyboardInterrupt, SystemExit])
def test_after_an_error_nothing_is_there(tmp_path, error):
    with pytest.raises(error):
        interrupt(tmp_path / "out", error, a="1")
    assert tree(tmp_path) == {}


def test_after_an_error_no_parent_is_there(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        interrupt(tmp_path / "x" / "y" / "out", KeyboardInterrupt, a="1")
    assert tree(tmp_path) == {}


def test_after_an_error_parents_stay_that_others_have_begun_to_use(tmp_path):
    publishing = results_folder(tmp_path / "x" / "y" / "out", force=False)
    publishing.__enter__()
    fill(tmp_path / "x", a="of another process")
    assert not publishing.__exit__(KeyboardInterrupt, KeyboardInterrupt(), None)
    assert tree(tmp_path) == {"x": None, "x/a": "of another process"}


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_after_an_error_earlier_results_are_as_they_were(tmp_path, error):
    target = tmp_path / "out"
    fill(target, a="old", b="old")
    with pytest.raises(error):
        interrupt(target, error, force=True, a="new")
    assert tree(tmp_path) == {"out": None, "out/a": "old", "out/b": "old"}


KILLED = """
import os, signal, sys
from pathlib import Path
from steelyard.output import results_folder
with results_folder(Path(sys.argv[1]), force=True) as folder:
    (folder / "a").write_text("new")
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.parametrize("before", [False, True])
def test_a_process_that_is_killed_leaves_no_half_results(tmp_path, before):
    target = tmp_path / "out"
    if before:
        fill(target, a="old", b="old")
    ended = finished([sys.executable, "-c", KILLED, str(target)])
    assert ended.returncode == -signal.SIGKILL
    if before:
        assert {name: text for name, text in tree(target).items() if not name.startswith(".")} == {
            "a": "old",
            "b": "old",
        }
    else:
        assert not target.exists()
    # What it had begun is hidden, and does not stand in the way of the next one.
    assert all(path.name.startswith(".") for path in tmp_path.iterdir() if path != target)
    publish(target, force=before, a="1")
    assert (target / "a").read_text() == "1"


@pytest.mark.parametrize("error", [OSError, KeyboardInterrupt])
def test_an_error_while_results_are_put_in_place_loses_nothing(tmp_path, monkeypatch, error):
    target = tmp_path / "out"
    fill(target, a="old", b="old", c="old")
    monkeypatch.chdir(target)
    rename, moved = os.rename, []

    def failing(path, other):
        # Only moves into place fail: moving back must be possible.
        if Path(other) == target / "b" and not moved:
            moved.append(other)
            raise error
        return rename(path, other)

    monkeypatch.setattr(os, "rename", failing)
    with pytest.raises(error):
        publish(target, force=True, a="new", b="new", c="new")
    assert moved
    assert tree(tmp_path) == {"out": None, "out/a": "old", "out/b": "old", "out/c": "old"}


# All at once


def test_a_reader_sees_results_of_one_run_only(tmp_path, monkeypatch):
    target = tmp_path / "out"
    fill(target, a="old", b="old", mine="mine")
    seen = []
    exchange = placing.exchange

    def watched(one, other):
        seen.append(tree(target))
        exchange(one, other)
        seen.append(tree(target))

    monkeypatch.setattr(placing, "exchange", watched)
    publish(target, force=True, a="new", b="new", c="new")
    assert seen == [
        {"a": "old", "b": "old", "mine": "mine"},
        {"a": "new", "b": "new", "c": "new", "mine": "mine"},
    ]


def test_a_folder_keeps_its_rights_and_what_else_lies_in_it(tmp_path):
    target = tmp_path / "out"
    fill(target, a="old", mine="mine")
    fill(target / "notes" / "far", b="mine")
    (target / "link").symlink_to("nowhere")
    target.chmod(0o750)
    (target / "notes").chmod(0o500)
    before = (target / "mine").stat()
    publish(target, force=True, a="new", b="new")
    assert (target / "mine").stat().st_ino == before.st_ino
    assert (target / "mine").stat().st_nlink == 1
    assert (target / "link").readlink() == Path("nowhere")
    assert target.stat().st_mode & 0o777 == 0o750
    assert (target / "notes").stat().st_mode & 0o777 == 0o500
    assert (target / "notes" / "far" / "b").read_text() == "mine"
    assert tree(tmp_path).keys() == {
        "out", "out/a", "out/b", "out/link", "out/mine", "out/notes", "out/notes/far",
        "out/notes/far/b",
    }  # fmt: skip


def test_what_others_write_meanwhile_stays(tmp_path, monkeypatch):
    target = tmp_path / "out"
    fill(target, a="old", mine="mine", edited="mine")
    fill(target / "notes", b="mine")
    exchange = placing.exchange

    def late(one, other):
        fill(target, late="of another process")
        fill(target / "notes", late="of another process")
        fill(tmp_path, edited="edited")
        (tmp_path / "edited").replace(target / "edited")
        exchange(one, other)

    monkeypatch.setattr(placing, "exchange", late)
    publish(target, force=True, a="new", b="new")
    assert tree(tmp_path) == {
        "out": None,
        "out/a": "new",
        "out/b": "new",
        "out/edited": "edited",
        "out/late": "of another process",
        "out/mine": "mine",
        "out/notes": None,
        "out/notes/b": "mine",
        "out/notes/late": "of another process",
    }


@pytest.mark.parametrize("missing", ["call", "device"])
def test_where_folders_cannot_be_exchanged_files_are_moved_one_by_one(
    tmp_path, monkeypatch, missing
):
    target = tmp_path / "out"
    fill(target, a="old", b="old", mine="mine")
    if missing == "call":
        monkeypatch.setattr(disk, "_renameat2", lambda: None)
    else:
        monkeypatch.setattr(placing, "exchange", no_exchange)
    publish(target, force=True, a="new", b="new")
    assert tree(tmp_path) == {"out": None, "out/a": "new", "out/b": "new", "out/mine": "mine"}


def no_exchange(one, other):
    raise OSError(22, "Invalid argument", str(one))


# What killed processes left


def test_what_a_killed_process_left_is_removed_by_the_next_one(tmp_path):
    target = tmp_path / "out"
    for _ in range(2):
        ended = finished([sys.executable, "-c", KILLED, str(target)])
        assert ended.returncode == -signal.SIGKILL
    # The second has removed what the first one left.
    assert len(list(tmp_path.glob(".steelyard-*"))) == 1
    publish(target, a="1")
    assert tree(tmp_path) == {"out": None, "out/a": "1"}


def test_of_a_process_that_lives_nothing_is_removed(tmp_path):
    with results_folder(tmp_path / "one", force=False) as folder:
        fill(folder, a="1")
        publish(tmp_path / "other", a="2")
        settle(tmp_path / "one")
        assert tree(folder) == {"a": "1"}
    assert tree(tmp_path) == {"one": None, "one/a": "1", "other": None, "other/a": "2"}


@pytest.mark.parametrize("files", [{"mine": "1"}, {"plan.json": "{}"}])
def test_what_is_not_surely_ours_is_not_removed(tmp_path, files):
    fill(tmp_path / ".steelyard-mine", **files)
    publish(tmp_path / "out", a="1")
    assert tree(tmp_path / ".steelyard-mine") == files


@pytest.mark.parametrize(
    "plan",
    [
        "{}",
        "[",
        "null",
        '{"place": "..", "names": ["a"], "inode": 0}',
        '{"place": "", "names": ["../a"], "inode": 0}',
        '{"place": "", "names": [1], "inode": 0}',
        '{"place": 3, "names": [], "inode": 0}',
    ],
)
def test_a_plan_that_leads_elsewhere_is_not_followed(tmp_path, plan):
    left = tmp_path / "far" / ".steelyard-x"
    fill(left, **{"plan.json": plan, "lock": ""})
    fill(left / "new", a="hostile")
    settle(tmp_path / "far" / "out")
    assert tree(tmp_path)["far/.steelyard-x/new/a"] == "hostile"
    assert not (tmp_path / "a").exists()


def test_two_writers_leave_the_results_of_one(tmp_path):
    target = tmp_path / "out"
    fill(target, a="old", b="old")
    with results_folder(target, force=True) as one:
        with results_folder(target, force=True) as other:
            fill(one, a="1", b="1")
            fill(other, a="2", b="2")
        assert tree(target) == {"a": "2", "b": "2"}
    assert tree(tmp_path) == {"out": None, "out/a": "1", "out/b": "1"}


# What may be replaced


def test_results_are_not_replaced_without_force(tmp_path):
    fill(tmp_path / "out", a="old")
    with pytest.raises(InputError, match=r"found files; .*force=True"):
        publish(tmp_path / "out", a="new")
    assert tree(tmp_path) == {"out": None, "out/a": "old"}


def test_a_hidden_file_is_a_file(tmp_path):
    fill(tmp_path / "out", **{".git": "old"})
    with pytest.raises(InputError, match="found files"):
        check_target(tmp_path / "out", force=False)


def test_force_replaces_files_of_the_same_names_alone(tmp_path):
    target = tmp_path / "out"
    fill(target, a="old", other="mine")
    fill(target / "inner", b="old", c="old")
    fill(target / "notes", d="mine")
    with results_folder(target, force=True) as folder:
        fill(folder, a="new", fresh="new")
        fill(folder / "inner", b="new")
    assert tree(tmp_path) == {
        "out": None,
        "out/a": "new",
        "out/fresh": "new",
        "out/inner": None,
        "out/inner/b": "new",
        "out/notes": None,
        "out/notes/d": "mine",
        "out/other": "mine",
    }


def test_a_link_is_replaced_and_not_followed(tmp_path):
    target = tmp_path / "out"
    fill(tmp_path, precious="mine")
    target.mkdir()
    (target / "a").symlink_to(tmp_path / "precious")
    (target / "b").symlink_to(tmp_path / "nowhere")
    publish(target, force=True, a="new", b="new")
    assert tree(tmp_path) == {"precious": "mine", "out": None, "out/a": "new", "out/b": "new"}
    assert not (target / "a").is_symlink()


def test_a_file_gives_way_to_a_folder_and_a_folder_to_a_file(tmp_path):
    target = tmp_path / "out"
    fill(target, a="old")
    fill(target / "b", c="old")
    with results_folder(target, force=True) as folder:
        fill(folder, b="new")
        fill(folder / "a", c="new")
    assert tree(target) == {"a": None, "a/c": "new", "b": "new"}


def test_a_folder_that_appears_meanwhile_is_not_replaced(tmp_path):
    target = tmp_path / "out"
    publishing = results_folder(target, force=False)
    fill(publishing.__enter__(), a="new")
    fill(target, a="of another process")
    with pytest.raises(InputError, match="found files"):
        publishing.__exit__(None, None, None)
    assert tree(tmp_path) == {"out": None, "out/a": "of another process"}


# Places


@pytest.mark.parametrize("force", [False, True])
@pytest.mark.parametrize("place", ["file", "file/below", "file/far/below"])
def test_a_file_is_no_place_for_results(tmp_path, place, force):
    fill(tmp_path, file="mine")
    with pytest.raises(InputError, match="choose another"):
        publish(tmp_path / place, force=force, a="new")
    assert tree(tmp_path) == {"file": "mine"}


@pytest.mark.parametrize("files", [{}, {"a": "old", "b": "old"}])
def test_a_link_to_a_folder_is_a_folder(tmp_path, files):
    fill(tmp_path / "real", **files)
    (tmp_path / "out").symlink_to(tmp_path / "real")
    publish(tmp_path / "out", force=bool(files), a="new")
    assert (tmp_path / "out").is_symlink()
    assert tree(tmp_path / "real") == {**files, "a": "new"}


def test_a_link_to_nothing_is_refused_before_any_work(tmp_path):
    (tmp_path / "out").symlink_to(tmp_path / "nowhere")
    with pytest.raises(InputError, match="out: expected "):
        check_target(tmp_path / "out", force=False)


def test_a_long_name_that_fits_is_no_trouble(tmp_path):
    name = "o" * os.pathconf(tmp_path, "PC_NAME_MAX")
    publish(tmp_path / name, a="1")
    assert tree(tmp_path / name) == {"a": "1"}


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is forbidden to root")
def test_a_folder_of_ones_own_in_a_folder_of_another(tmp_path):
    # As /data of a container, or a mount point: what is beside it is not ours.
    fill(tmp_path / "theirs" / "mine")
    (tmp_path / "theirs").chmod(0o555)
    try:
        publish(tmp_path / "theirs" / "mine", a="1")
        publish(tmp_path / "theirs" / "mine", force=True, a="2")
        with pytest.raises(InputError, match="expected a place that can be written to"):
            check_target(tmp_path / "theirs" / "new", force=False)
    finally:
        (tmp_path / "theirs").chmod(0o755)
    assert tree(tmp_path / "theirs") == {"mine": None, "mine/a": "2"}


def test_nothing_is_made_beside_a_folder_that_exists(tmp_path, monkeypatch):
    # The same for root, to whom nothing is forbidden.
    target = tmp_path / "mine"
    target.mkdir()
    mkdir, rename = os.mkdir, os.rename

    def within(path, *mode):
        if target not in Path(path).parents:
            raise PermissionError(13, "Permission denied", str(path))
        mkdir(path, *mode)

    def moved_within(path, other):
        if target not in Path(other).parents:
            raise PermissionError(13, "Permission denied", str(other))
        rename(path, other)

    monkeypatch.setattr(os, "mkdir", within)
    monkeypatch.setattr(os, "rename", moved_within)
    publish(target, a="1")
    publish(target, force=True, a="2")
    assert tree(tmp_path) == {"mine": None, "mine/a": "2"}


def test_results_for_a_folder_that_exists_are_prepared_on_the_same_device(tmp_path, monkeypatch):
    # Moves between devices fail, and a mount point is on another device than what is beside it.
    target = tmp_path / "mounted"
    target.mkdir()
    rename = os.rename

    def within(path, other):
        if (target in Path(path).parents) != (target in Path(other).parents):
            raise OSError(18, "Invalid cross-device link", str(path))
        return rename(path, other)

    monkeypatch.setattr(os, "rename", within)
    monkeypatch.setattr(placing, "exchange", no_exchange)
    publish(target, a="1")
    publish(target, force=True, a="2", b="2")
    assert tree(tmp_path) == {"mounted": None, "mounted/a": "2", "mounted/b": "2"}


def test_a_check_changes_nothing(tmp_path):
    check_target(tmp_path / "x" / "out", force=False)
    assert tree(tmp_path) == {}


# JSON


def test_json_has_every_digit_and_no_escapes(tmp_path):
    write_json({"b": 0.1 + 0.2, "a": ["µ", None, True]}, tmp_path / "a.json")
    text = (tmp_path / "a.json").read_text(encoding="utf-8")
    assert text.endswith("}\n")
    assert "0.30000000000000004" in text
    assert "µ" in text
    assert text.index('"b"') < text.index('"a"')


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_json_has_no_nan(value):
    with pytest.raises(ValueError, match="not JSON compliant"):
        to_json({"a": [value]})
