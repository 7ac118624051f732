"""Machine code from a cache is this user's own, and whole."""

import errno
import os
import pickle
import subprocess
import sys
from pathlib import Path

import platformdirs
import pytest

from mercator_design.system import kernel_cache
from mercator_design.system.kernel_cache import Turn, _Digesting, is_whole, place, why_not_private
from mercator_design.system.user_folders import user_folder

IS_ROOT = os.geteuid() == 0
OTHER = 65533


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """The folder that NUMBA_CACHE_DIR names; the place is looked up anew."""
    given = "NUMBA_CACHE_DIR", str(tmp_path / "cache")
    monkeypatch.setattr(kernel_cache, "place", lambda name: (monkeypatch.setenv(*given), place.__wrapped__(name))[1])
    return tmp_path / "cache"


def written(path, data=b"machine code"):
    with path.open("wb") as file:
        digesting = _Digesting(file)
        digesting.write(data[:3])
        digesting.write(data[3:])
        file.write(digesting.digest.digest())
    path.chmod(0o600)
    return path


class TestFiles:
    def test_whole(self, tmp_path):
        assert is_whole(written(tmp_path / "f"))
        assert is_whole(written(tmp_path / "f", b"xxx"))

    def test_any_bit_that_flips(self, tmp_path):
        data = written(tmp_path / "f").read_bytes()
        for where in range(len(data)):
            for bit in range(8):
                (tmp_path / "f").write_bytes(data[:where] + bytes([data[where] ^ 1 << bit]) + data[where + 1 :])
                assert not is_whole(tmp_path / "f")

    def test_any_length(self, tmp_path):
        data = written(tmp_path / "f").read_bytes()
        for length in range(len(data)):
            (tmp_path / "f").write_bytes(data[:length])
            assert not is_whole(tmp_path / "f")
        (tmp_path / "f").write_bytes(data + b"x")
        assert not is_whole(tmp_path / "f")

    def test_what_is_no_file_of_this_user_alone(self, tmp_path):
        file = written(tmp_path / "f")
        (tmp_path / "link").symlink_to(file)
        os.mkfifo(tmp_path / "pipe")
        assert not any(map(is_whole, (tmp_path, tmp_path / "link", tmp_path / "pipe", tmp_path / "nothing")))
        for mode in (0o620, 0o602):
            file.chmod(mode)
            assert not is_whole(file)
        file.chmod(0o644)
        assert is_whole(file)

    @pytest.mark.skipif(not IS_ROOT, reason="only root can give files away")
    def test_of_another_user(self, tmp_path):
        file = written(tmp_path / "f")
        os.chown(file, OTHER, OTHER)
        assert not is_whole(file)


class TestFolders:
    @pytest.mark.parametrize("mode", [0o777, 0o707, 0o1777])
    def test_others_may_write_there(self, cache, mode):
        folder, problem = kernel_cache.place("x")
        assert (folder, problem) == (cache / "x", "")
        assert folder.stat().st_mode & 0o777 == 0o700
        folder.chmod(mode)
        found, problem = kernel_cache.place("x")
        assert found != folder
        assert f"{folder}: other users may write to {folder}; set NUMBA_CACHE_DIR" in problem
        assert found.stat().st_mode & 0o777 == 0o700

    def test_others_may_write_where_it_is(self, cache):
        folder, _ = kernel_cache.place("x")
        cache.chmod(0o777)
        assert f"other users may write to {cache}" in kernel_cache.place("x")[1]
        cache.chmod(0o1777)  # as /tmp
        assert kernel_cache.place("x") == (folder, "")
        cache.chmod(0o775)
        trusted = kernel_cache._is_trusted(cache.stat().st_gid)
        assert (kernel_cache.place("x")[1] == "") == trusted

    def test_a_link_is_followed_and_what_it_leads_to_is_checked(self, cache, tmp_path):
        (tmp_path / "real").mkdir(mode=0o700)
        cache.symlink_to(tmp_path / "real")
        assert kernel_cache.place("x") == (tmp_path / "real" / "x", "")
        (tmp_path / "real").chmod(0o777)
        assert f"other users may write to {tmp_path / 'real'}" in kernel_cache.place("x")[1]

    def test_a_link_to_itself(self, cache):
        cache.symlink_to(cache)
        assert "no file can be written there" in kernel_cache.place("x")[1]

    @pytest.mark.skipif(not IS_ROOT, reason="only root can give folders away")
    @pytest.mark.parametrize("which", [".", ".."])
    def test_of_another_user(self, cache, which):
        folder, _ = kernel_cache.place("x")
        os.chown(folder / which, OTHER, OTHER)
        found, problem = kernel_cache.place("x")
        assert found != folder
        assert f"belongs to user {OTHER}, not to 0" in problem

    def test_whatever_the_mask(self, cache):
        before = os.umask(0)
        try:
            assert kernel_cache.place("x") == (cache / "x", "")
        finally:
            os.umask(before)
        assert why_not_private(cache / "x") == ""

    def test_nowhere_to_write(self, cache, monkeypatch):
        def full(**_):
            raise FileNotFoundError("no usable temporary folder")

        cache.write_text("a file")
        monkeypatch.setattr(kernel_cache.tempfile, "mkdtemp", full)
        folder, problem = kernel_cache.place("x")
        assert folder is None
        assert "no file can be written there" in problem


class TestWithoutAHome:
    @pytest.mark.usefixtures("homeless")
    def test_code_is_kept_in_a_private_folder_also_for_processes_that_are_started(self, monkeypatch):
        monkeypatch.setenv("NUMBA_CACHE_DIR", "")
        folder, problem = place.__wrapped__("x")
        assert problem == "this user has no home folder; set NUMBA_CACHE_DIR to a folder of your own"
        assert folder.parent.stat().st_mode & 0o777 == folder.stat().st_mode & 0o777 == 0o700
        assert place.__wrapped__("x") == (folder, "")  # as in another process of this environment

    @pytest.mark.usefixtures("homeless")
    def test_a_folder_that_is_named_is_used(self, cache):
        assert kernel_cache.place("x") == (cache / "x", "")

    @pytest.mark.usefixtures("homeless")
    @pytest.mark.parametrize("kind", ["cache", "config"])
    def test_no_folder_is_made_up(self, monkeypatch, kind):
        assert user_folder(kind) is None
        monkeypatch.setattr(platformdirs, f"user_{kind}_path", lambda name: Path("~", name))  # of older versions
        assert user_folder(kind) is None


class TestReadOnly:
    @pytest.fixture
    def written_before(self, cache, monkeypatch):
        """What is in the cache, of which nothing can be changed any more."""
        folder, _ = kernel_cache.place("x")
        (folder / "kernels").mkdir()
        written(folder / "kernels" / "code")
        (folder / "kernels").chmod(0o500)

        def refused(**_):
            raise OSError(errno.EROFS, "Read-only file system")

        monkeypatch.setattr(kernel_cache.tempfile, "TemporaryFile", refused)
        return folder / "kernels" / "code"

    def test_what_is_there_is_used_and_more_is_written_elsewhere(self, written_before):
        folder, problem = kernel_cache.place("x")
        copy = folder / "kernels" / "code"
        assert copy != written_before
        assert is_whole(copy)
        assert (folder / "kernels").stat().st_mode & 0o777 == 0o700
        assert problem.startswith(f"{written_before.parents[1]}: no file can be written there; set NUMBA_CACHE_DIR")

    def test_what_is_there_is_used_where_no_file_can_be_written_at_all(self, written_before, monkeypatch):
        def refused(**_):
            raise OSError(errno.EROFS, "Read-only file system")

        monkeypatch.setattr(kernel_cache.tempfile, "mkdtemp", refused)
        assert kernel_cache.place("x")[0] == written_before.parents[1]


class _Evil:
    def __init__(self, file):
        self.file = file

    def __reduce__(self):
        return os.mkdir, (str(self.file),)


def test_what_others_planted_is_not_run(tmp_path):
    """In a folder where they may write: the index is a pickle, which makes a folder when it is loaded."""
    script = "from mercator_design import jit; from mercator_design.modules.conditions import logistic\n"
    script += "print(jit.compiled(logistic)(0.0)); print(jit.cache_folder()); print(jit.cache_warning())"
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "NUMBA_DISABLE_JIT": "0"}

    def run():
        command = [sys.executable, "-c", script]
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.split("\n")

    value, folder, *_ = run()
    (index,) = Path(folder).glob("**/*.nbi")
    index.write_bytes(pickle.dumps(_Evil(tmp_path / "owned")))
    assert run() == [value, folder, "", ""]  # as its digest is not there
    Path(folder).chmod(0o777)
    written(index, pickle.dumps(_Evil(tmp_path / "owned")))
    found, other, problem, _ = run()
    assert (found, problem != "") == (value, True)
    assert other != folder
    assert not (tmp_path / "owned").exists()


class TestTurns:
    HOLD = """
import pathlib, sys, time
from mercator_design.system.kernel_cache import Turn
turn = Turn(pathlib.Path(sys.argv[1]))
turn.begin()
print("begun", flush=True)
sys.stdin.readline()
turn.end()
print("ended", flush=True)
sys.stdin.readline()
"""

    @pytest.fixture
    def file(self, tmp_path):
        return tmp_path / "new" / "kernel.lock"

    @pytest.fixture
    def other(self, file):
        """Another process that has its turn."""
        command = [sys.executable, "-c", self.HOLD, str(file)]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout.readline() == "begun\n"
            yield process
            process.kill()

    @staticmethod
    def has_it(turn):
        turn.begin(patience=0.0)
        return turn._is_mine()

    def test_one_at_a_time(self, file, other):
        turn = Turn(file)
        assert not self.has_it(turn)
        other.stdin.write("\n")
        other.stdin.flush()
        assert other.stdout.readline() == "ended\n"
        assert self.has_it(turn)
        assert not self.has_it(Turn(file))
        turn.end()
        turn.end()
        assert self.has_it(Turn(file))

    def test_it_ends_with_its_process(self, file, other):
        turn = Turn(file)
        assert not self.has_it(turn)
        other.kill()
        turn.begin()
        assert turn._is_mine()

    def test_no_file_can_be_written_there(self, tmp_path):
        (tmp_path / "file").write_text("no folder can be made here")
        turn = Turn(tmp_path / "file" / "lock")
        turn.begin()
        turn.end()


class _Cache:
    """A cache as numba's, of what `load` finds."""

    def __init__(self, load):
        self.load = load

    def load_overload(self, *_):
        return self.load()

    def save_overload(self, *_):
        pass


class TestWhoMayCompile:
    @pytest.fixture
    def turn(self, tmp_path):
        return Turn(tmp_path / "lock")

    @staticmethod
    def is_free(turn):
        other = Turn(turn._file)
        other.begin(patience=0.0)
        found = other._is_mine()
        other.end()
        return found

    def test_others_wait_until_it_is_saved_or_given_up(self, turn):
        cache = kernel_cache.Forgiving(_Cache(lambda: None), lambda: None, lambda: None, turn)
        for end in (lambda: cache.save_overload(None, None), cache.give_up):
            assert cache.load_overload(None, None) is None
            assert not self.is_free(turn)
            end()
            assert self.is_free(turn)

    def test_who_has_waited_finds_it(self, turn):
        found = iter([None, "machine code"])
        cache = kernel_cache.Forgiving(_Cache(lambda: next(found)), lambda: None, pytest.fail, turn)
        assert cache.load_overload(None, None) == "machine code"
        assert self.is_free(turn)

    def test_it_cannot_begin(self, turn):
        def fail():
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            kernel_cache.Forgiving(_Cache(lambda: None), lambda: None, fail, turn).load_overload(None, None)
        assert self.is_free(turn)
