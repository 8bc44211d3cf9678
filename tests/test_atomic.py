"""Files are written whole or not at all, and a fault is one plain sentence."""

from __future__ import annotations

import errno
import os
import stat
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from lithoform.atomic import atomic_path, atomic_write, remove_partials
from lithoform.errors import LithoformError, OutputError

posix = pytest.mark.skipif(os.name != "posix", reason="POSIX file system")


def run(code: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Run a piece of Python in a process of its own."""
    command = [sys.executable, "-W", "error", "-c", textwrap.dedent(code), *map(str, arguments)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    return subprocess.run(command, capture_output=True, text=True, env=environment, check=False)


def names(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir())


@pytest.mark.parametrize("data", [b"", b"x", bytes(range(256)) * 1000])
def test_writes_the_bytes_and_leaves_nothing_else(tmp_path, data):
    atomic_write(tmp_path / "a.bin", data)
    assert (tmp_path / "a.bin").read_bytes() == data
    assert names(tmp_path) == ["a.bin"]


def test_replaces_a_file_and_takes_text_paths(tmp_path):
    atomic_write(str(tmp_path / "a"), b"old and longer")
    atomic_write(str(tmp_path / "a"), b"new")
    assert (tmp_path / "a").read_bytes() == b"new"


def test_a_relative_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    atomic_write("a", b"1")
    assert names(tmp_path) == ["a"]


@posix
def test_the_mode_is_that_of_any_new_file(tmp_path):
    atomic_write(tmp_path / "a", b"")
    (tmp_path / "b").write_bytes(b"")
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == stat.S_IMODE((tmp_path / "b").stat().st_mode)


@posix
def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "real").write_bytes(b"old")
    (tmp_path / "link").symlink_to("real")
    atomic_write(tmp_path / "link", b"new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_bytes() == b"new"


@pytest.mark.parametrize("fault", [KeyboardInterrupt, SystemExit, ValueError, GeneratorExit])
def test_an_interrupted_write_leaves_the_old_file_alone(tmp_path, fault):
    (tmp_path / "a").write_bytes(b"old")

    def interrupted():
        with atomic_path(tmp_path / "a") as partial:
            partial.write_bytes(b"half")
            assert names(tmp_path) == sorted([partial.name, "a"])
            assert partial.name.startswith(".")
            assert partial.name.endswith(".partial")
            raise fault

    with pytest.raises(fault):
        interrupted()
    assert names(tmp_path) == ["a"]
    assert (tmp_path / "a").read_bytes() == b"old"


def test_nothing_is_visible_under_the_name_before_the_end(tmp_path):
    with atomic_path(tmp_path / "a") as partial:
        assert partial.parent == tmp_path.resolve()
        partial.write_bytes(b"1")
        assert not (tmp_path / "a").exists()
    assert names(tmp_path) == ["a"]


def test_two_writers_of_one_file_do_not_meet(tmp_path):
    with atomic_path(tmp_path / "a") as first, atomic_path(tmp_path / "a") as second:
        assert first != second
        first.write_bytes(b"1")
        second.write_bytes(b"2")
    assert (tmp_path / "a").read_bytes() == b"1"  # the outer block ends last
    assert names(tmp_path) == ["a"]


def test_a_folder_in_the_way(tmp_path):
    (tmp_path / "a").mkdir()
    with pytest.raises(OutputError, match=r"^cannot write .*a: a folder of that name is in the way; choose"):
        atomic_write(tmp_path / "a", b"1")
    assert names(tmp_path) == ["a"]


def test_a_folder_that_is_missing_or_a_file(tmp_path):
    with pytest.raises(OutputError, match="its folder does not exist; make the folder first"):
        atomic_write(tmp_path / "none" / "a", b"1")
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(OutputError, match="is a file, not a folder"):
        atomic_write(tmp_path / "file" / "a", b"1")
    with pytest.raises(OutputError, match="the name is too long"):
        atomic_write(tmp_path / ("a" * 300), b"1")
    atomic_write(tmp_path / ("a" * 250), b"1")  # the temporary name is no longer than this


@posix
def test_a_pipe_or_a_device_is_not_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OutputError, match="not a file"):
        atomic_write(tmp_path / "pipe", b"1")
    assert stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission(tmp_path):
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(OutputError, match="permission is denied; write to a folder of your own"):
            atomic_write(tmp_path / "a", b"1")
    finally:
        tmp_path.chmod(0o700)
    assert names(tmp_path) == []


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.ENOSPC, "the disk is full; free some space"),
        (errno.EACCES, "permission is denied"),
        (errno.EROFS, "read-only"),
        (errno.EFBIG, "larger than the system allows"),
        (errno.EIO, r"put/output error|[Ii]/[Oo] error"),
    ],
)
def test_a_fault_is_one_sentence(tmp_path, number, words):
    with pytest.raises(OutputError, match=words) as caught, atomic_path(tmp_path / "a"):
        raise OSError(number, os.strerror(number))
    message = str(caught.value)
    assert message.startswith(f"cannot write {tmp_path / 'a'}: ")
    assert message.endswith(".")
    assert "\n" not in message
    assert isinstance(caught.value, LithoformError)
    assert isinstance(caught.value, OSError)
    assert names(tmp_path) == []


def test_a_fault_of_another_file_is_not_blamed_on_this_one(tmp_path):
    with pytest.raises(FileNotFoundError), atomic_path(tmp_path / "a") as partial:
        partial.write_bytes((tmp_path / "input").read_bytes())
    assert names(tmp_path) == []


@posix
def test_a_disk_without_room(tmp_path):
    (tmp_path / "a").write_bytes(b"old")
    code = """
        import resource, sys
        from lithoform.atomic import atomic_write
        from lithoform.errors import OutputError
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
        try:
            atomic_write(sys.argv[1], bytes(100_000))
        except OutputError as error:
            print(error)
    """
    done = run(code, tmp_path / "a")
    assert done.stderr == ""
    assert "larger than the system allows; raise the limit" in done.stdout
    assert names(tmp_path) == ["a"]
    assert (tmp_path / "a").read_bytes() == b"old"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_the_fault_of_a_full_device(tmp_path):
    def write():
        with atomic_path(tmp_path / "a") as partial:
            partial.unlink()
            partial.symlink_to("/dev/full")
            partial.write_bytes(b"1")

    with pytest.raises(OutputError, match="the disk is full"):
        write()
    assert names(tmp_path) == []


def test_what_a_killed_run_leaves_can_be_removed(tmp_path):
    code = """
        import os, sys
        from lithoform.atomic import atomic_path
        with atomic_path(sys.argv[1]) as partial:
            partial.write_bytes(b"half")
            os._exit(9)
    """
    assert run(code, tmp_path / "a.stl").returncode == 9
    (left,) = tmp_path.iterdir()
    keep = [".hidden", "b.partial", "c.stl", ".partial.txt"]
    for name in keep:
        (tmp_path / name).write_bytes(b"")
    (tmp_path / ".folder.partial").mkdir()
    assert remove_partials(tmp_path) == [left]
    assert names(tmp_path) == sorted([*keep, ".folder.partial"])
    assert remove_partials(str(tmp_path)) == []


def test_removing_from_no_folder(tmp_path):
    with pytest.raises(OutputError, match="no such file"):
        remove_partials(tmp_path / "none")
