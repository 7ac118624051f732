"""Machine code from a cache is this user's own, and whole."""

import contextlib
import errno
import fcntl
import os
import pickle
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import platformdirs
import pytest

from mercator_design import jit
from mercator_design.compiling import cache as kernel_cache
from mercator_design.compiling.cache import place, read_whole, turn, write_whole
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
    write_whole(path, data)
    return path


def is_whole(path):
    try:
        read_whole(path)
    except OSError:
        return False
    return True


class TestFiles:
    def test_whole(self, tmp_path):
        for data in (b"machine code", b"xxx", b""):
            assert read_whole(written(tmp_path / "f", data)) == data
            assert [*tmp_path.iterdir()] == [tmp_path / "f"]
            assert (tmp_path / "f").stat().st_mode & 0o777 == 0o600

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
        os.mkfifo(tmp_path / "pipe")
        assert not any(map(is_whole, (tmp_path, tmp_path / "pipe", tmp_path / "nothing")))
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

    def test_a_draft_of_what_cannot_be_written_is_removed(self, tmp_path):
        (tmp_path / "f" / "full").mkdir(parents=True)
        with pytest.raises(OSError, match="directory"):
            written(tmp_path / "f")
        assert [*tmp_path.iterdir()] == [tmp_path / "f"]


class TestFolders:
    def test_only_this_user_may_enter_it(self, cache):
        folder, problem = kernel_cache.place("x")
        assert (folder, problem) == (cache / "x", "")
        assert folder.stat().st_mode & 0o777 == 0o700

    def test_a_link_to_itself(self, cache):
        cache.symlink_to(cache)
        assert "no file can be written there" in kernel_cache.place("x")[1]

    @pytest.mark.skipif(not IS_ROOT, reason="only root can give folders away")
    def test_of_another_user(self, cache):
        """Of its files, only this user's are copied."""
        folder, _ = kernel_cache.place("x")
        for name in ("ours", "theirs"):
            written(folder / name)
        for path in (folder, folder / "theirs"):
            os.chown(path, OTHER, OTHER)
        found, problem = kernel_cache.place("x")
        assert [*found.iterdir()] == [found / "ours"]
        assert found.parent.stat().st_mode & 0o777 == 0o700
        assert f"{folder} belongs to user {OTHER}, not to 0; set NUMBA_CACHE_DIR" in problem

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
        assert folder.parent.stat().st_mode & 0o777 == 0o700
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
        written(folder / "code")

        def refused(**_):
            raise OSError(errno.EROFS, "Read-only file system")

        monkeypatch.setattr(kernel_cache.tempfile, "TemporaryFile", refused)
        return folder / "code"

    def test_what_is_there_is_used_and_more_is_written_elsewhere(self, written_before):
        folder, problem = kernel_cache.place("x")
        assert folder != written_before.parent
        assert read_whole(folder / "code") == b"machine code"
        assert problem.startswith(f"{written_before.parent}: no file can be written there; set NUMBA_CACHE_DIR")

    def test_what_is_there_is_used_where_no_file_can_be_written_at_all(self, written_before, monkeypatch):
        def refused(**_):
            raise OSError(errno.EROFS, "Read-only file system")

        monkeypatch.setattr(kernel_cache.tempfile, "mkdtemp", refused)
        assert kernel_cache.place("x")[0] == written_before.parent


class _Evil:
    def __init__(self, file):
        self.file = file

    def __reduce__(self):
        return os.mkdir, (str(self.file),)


@pytest.mark.thorough
def test_what_others_planted_is_not_run(tmp_path):
    """In a folder where they may write: it is a pickle, which makes a folder when it is loaded."""
    script = "from mercator_design import jit; from mercator_design.modules.conditions import logistic\n"
    script += "print(jit.compiled(logistic)(0.0)); print(jit.cache_folder())"
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "NUMBA_DISABLE_JIT": "0"}

    def run():
        command = [sys.executable, "-c", script]
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.split("\n")

    found = run()
    (file,) = code(Path(found[1]))
    Path(found[1]).chmod(0o777)
    file.write_bytes(pickle.dumps(_Evil(tmp_path / "owned")))  # without a digest
    assert run() == found
    written(file, pickle.dumps(_Evil(tmp_path / "owned")))
    file.chmod(0o666)
    assert run() == found
    assert not (tmp_path / "owned").exists()


@pytest.mark.skipif(not jit.jit_wanted(), reason="plain Python compiles nothing")
class TestOneFunction:
    @pytest.fixture
    def value(self, tmp_path, monkeypatch):
        """Gives a function's value for a number, and how often it was compiled for that."""

        def value(kernel, x):
            missed = []
            monkeypatch.setattr(jit, "cache_folder", lambda: tmp_path)
            monkeypatch.setattr(jit, "_missed", lambda: missed.append(None))
            return jit._Entry(kernel)(x), len(missed)

        return value

    def test_each_type_and_each_code_has_a_file(self, value, tmp_path):
        kernels = [_made(1.0), _made(2.0)]
        found = [value(kernel, x) for _ in range(2) for kernel in kernels for x in (3, 3.0)]
        assert found == [(result, n) for n in (1, 0) for result in (4.0, 4.0, 6.0, 6.0)]
        assert len(code(tmp_path)) == 4

    def test_the_file_of_another_key_is_not_run(self, value, tmp_path):
        """As where two keys have one digest."""
        value(one := _made(1.0), 3.0)
        (file,) = code(tmp_path)
        data = file.read_bytes()
        value(other := _made(2.0), 3.0)
        (second,) = {*code(tmp_path)} - {file}
        second.write_bytes(data)
        assert value(other, 3.0) == (6.0, 1)
        assert value(one, 3.0) == (4.0, 0)

    def test_a_full_disk_keeps_nothing(self, value, tmp_path, monkeypatch):
        def full(*_):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        with monkeypatch.context() as patch:
            patch.setattr(kernel_cache, "write_whole", full)
            assert value(_made(1.0), 3.0) == (4.0, 1)
        assert code(tmp_path) == []

    def test_one_that_another_process_has_just_compiled_is_found(self, value, monkeypatch, tmp_path):
        kernel = _made(1.0)

        @contextlib.contextmanager
        def wait(file):
            monkeypatch.setattr(kernel_cache, "turn", turn)
            assert value(kernel, 3.0) == (4.0, 1)
            yield

        monkeypatch.setattr(kernel_cache, "turn", wait)
        written = []
        monkeypatch.setattr(kernel_cache, "write_whole", lambda *given: written.append(given) or write_whole(*given))
        assert value(kernel, 3.0) == (4.0, 1)
        assert len(written) == 1

    @pytest.mark.parametrize("body", ["x + 1", "x.no_such_thing"])
    def test_others_wait_until_it_is_compiled_or_cannot_be(self, value, monkeypatch, tmp_path, body):
        names = {}
        exec(f"def kernel(x):\n    return {body}", names)  # noqa: S102 - our own
        began = []
        monkeypatch.setattr(kernel_cache, "turn", lambda file: began.append(file) or turn(file))
        with contextlib.suppress(jit.CompilationError):
            value(names["kernel"], 3.0)
        assert is_free(*began)


class TestTurns:
    def test_one_at_a_time(self, tmp_path):
        with turn(tmp_path / "lock"):
            assert not is_free(tmp_path / "lock")
        assert is_free(tmp_path / "lock")

    def test_it_waits(self, tmp_path, monkeypatch):
        """Until the other one has ended."""
        other = contextlib.ExitStack()
        other.enter_context(turn(tmp_path / "lock"))
        monkeypatch.setattr(kernel_cache.time, "sleep", lambda _: other.close())
        with turn(tmp_path / "lock"):
            assert not is_free(tmp_path / "lock")

    def test_it_does_not_wait_forever(self, tmp_path, monkeypatch):
        """The other one may have been stopped."""
        clock = iter(range(10**6))
        monkeypatch.setattr(kernel_cache, "time", SimpleNamespace(monotonic=lambda: next(clock), sleep=lambda _: None))
        with turn(tmp_path / "lock"), turn(tmp_path / "lock"):
            assert next(clock) > 180

    def test_where_no_file_can_be_made_there_are_none(self, tmp_path):
        cache = kernel_cache.cache_of(lambda: None, tmp_path / "nowhere", "", lambda: None)
        assert cache.load_overload((), jit._Entry(lambda: None)._entry.targetctx) is None


def is_free(file):
    with file.open("rb") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True


def code(folder):
    """The files of a folder but for locks, which are empty."""
    return [file for file in folder.iterdir() if file.stat().st_size]


def _made(step):
    def kernel(x):
        return x * step if step > 1.5 else x + step

    return kernel
