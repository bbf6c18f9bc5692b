"""Studies on one machine: what a store holds, and that it survives whatever happens to a run."""

import errno
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
import study_functions as f

pytest.importorskip("zarr")
pytest.importorskip("xarray")

from jaxfric import InputError, study
from jaxfric.study.place import Directory
from jaxfric.study.store import Store, attributes

SCRIPT = str(Path(f.__file__))


def process(*arguments, **environment):
    f.heed_interrupts()
    return subprocess.Popen(
        [sys.executable, SCRIPT, *map(str, arguments)],
        env=os.environ | f.PAUSED | environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )


def by_hand(x, y):
    with np.errstate(all="ignore"):
        ratio = np.divide(x, y)
    return {"sum": x + 2 * y, "ratio": ratio, "sign": x > y, "row": np.stack([x, y, x * y])}


def assert_same_as_a_loop(found):
    for i, x in enumerate(found.x.values):
        for j, y in enumerate(found.y.values):
            for name, value in by_hand(x, y).items():
                np.testing.assert_array_equal(found[name].values[i, j], value)
            assert found.outcome.values[i, j] == (x == y == 0)


@pytest.mark.parametrize("chunk", [3, 10, 1000])
def test_equals_a_plain_loop(tmp_path, chunk):
    found = study.run(f.waves, f.grid(), tmp_path / "a", outputs=f.OUTPUTS, chunk=chunk, batch=4)
    assert dict(found.sizes) == {"x": 7, "y": 5, "third": 3, "block": found.done.size}
    assert_same_as_a_loop(found)
    assert found["sum"].attrs["units"] == "m" and found.x.attrs["units"] == "m"
    assert found.sign.attrs["flag_meanings"] == "below above"
    assert found.attrs["versions"]["jax"]


def test_sorting_changes_nothing(tmp_path):
    plain = study.run(f.waves, f.grid(), tmp_path / "a", outputs=f.OUTPUTS, batch=4)
    sorted_ = study.run(
        f.waves, f.grid(), tmp_path / "b", outputs=f.OUTPUTS, batch=4, cost=lambda p: -p["y"]
    )
    for name in ("sum", "ratio", "sign", "row", "outcome"):
        np.testing.assert_array_equal(plain[name], sorted_[name])


def test_outputs_are_inferred_and_batches_taken_whole(tmp_path):
    def many(p):
        return {"size": p["x"] * 0 + p["x"].shape[0], "pair": jnp.stack([p["x"], p["y"]], axis=1)}

    found = study.run(many, f.grid(), tmp_path / "a", kind="batch", batch=8)
    assert np.all(found["size"] == 8) and found.pair.dims == ("x", "y", "pair_0")
    np.testing.assert_array_equal(found.pair[..., 1], np.broadcast_to(found.y, (7, 5)))


@pytest.mark.parametrize("kind", ["member", "batch", "host"])
def test_complex_outputs_are_refused(tmp_path, kind):
    """Listed or inferred. An array of them would be stored by its real part alone."""
    for listed in [(study.Output("z"),), None][: 1 if kind == "host" else 2]:
        with pytest.raises(InputError, match="output 'z' is complex; return its real and"):
            study.run(
                lambda p: {"z": np.asarray(1j) * p["x"]},
                f.grid(),
                tmp_path / "a",
                outputs=listed,
                kind=kind,
            )
        shutil.rmtree(tmp_path / "a", ignore_errors=True)


@pytest.mark.parametrize("value", [1.0, jnp.ones(3)])
def test_batches_without_an_axis_of_members_are_refused(tmp_path, value):
    with pytest.raises(InputError, match=r"'z' has shape .* for 1 members; .*'batch' returns"):
        study.run(lambda p: {"z": value}, f.grid(), tmp_path / "a", kind="batch")


def test_samples_are_in_the_store(tmp_path):
    g = f.grid(3, 2, samples=11)
    found = study.run(lambda p: {"echo": p["z"] + 0 * p["x"]}, g, tmp_path / "a", chunk=10)
    expected = g.samples.draw(0, 11)["z"]
    np.testing.assert_array_equal(found.z, expected)
    np.testing.assert_array_equal(found.echo[:, 1, 1], expected)
    assert found.echo.dims == ("sample", "x", "y")


def test_single_precision(tmp_path):
    found = study.run(f.waves, f.grid(), tmp_path / "a", outputs=f.OUTPUTS, dtype="float32")
    assert found["sum"].dtype == np.float32
    np.testing.assert_allclose(found["sum"][1], 0.5 + 2 * found.y.values, rtol=1e-6)


def test_a_failing_member_is_a_row(tmp_path):
    g = study.Grid((study.values("x", [0.0, 2.0, 4.0]), study.values("y", [np.pi])))
    found = study.run(f.slowly, g, tmp_path / "a", outputs=f.SLOWLY, kind="host", chunk=2)
    assert found.outcome.values.ravel().tolist() == [0, 2, 0]
    np.testing.assert_array_equal(found.value[:, 0], [np.pi, np.nan, 2 + np.pi])


def test_memory_is_that_of_a_chunk():
    """A study of 1e12 members begins at once, anywhere."""
    g = study.Grid(
        (study.linspace("y", 0, 1, 10**6),), study.Samples(10**6, f.grid(2, 2, 2).samples.columns)
    )
    part = g.members((slice(999_990, 999_999), slice(3, 5)))
    assert g.size == 10**12 and len(part["z"]) == 18


def test_two_devices_give_what_one_gives(tmp_path):
    flags = os.environ.get("XLA_FLAGS", "") + " --xla_force_host_platform_device_count=2"
    two = process("waves", tmp_path / "two", XLA_FLAGS=flags, JAX_ENABLE_X64="1")
    assert two.wait(100) == 0, two.stderr.read()
    one = study.run(
        f.waves, f.grid(101, 53), tmp_path / "one", outputs=f.OUTPUTS, chunk=1000, batch=64
    )
    found = study.load(tmp_path / "two")
    for name in ("sum", "ratio", "sign", "row", "outcome"):
        np.testing.assert_array_equal(found[name], one[name])


# ---- what may happen to a run ---------------------------------------------------------------


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    path = tmp_path_factory.mktemp("undisturbed") / "a"
    f.run_slowly(path)
    return path


@pytest.fixture(scope="module")
def undisturbed(finished):
    return f.contents(finished)


def marks(path):
    folder = path / "done" / "c"
    return len(list(folder.iterdir())) if folder.exists() else 0


def killed(path, after, how=signal.SIGKILL, meanwhile=lambda: None):
    """Run, wait for a chunk to be written, and then `after` [s] more."""
    before = marks(path)
    run = process("slowly", path)
    while marks(path) == before and run.poll() is None:
        time.sleep(0.002)
    meanwhile()
    time.sleep(after)
    run.send_signal(how)
    code = run.wait(30)
    return code, run.stderr.read().decode()


def test_a_killed_run_goes_on(tmp_path, undisturbed):
    path = tmp_path / "a"
    assert killed(path, 0.2)[0] == -signal.SIGKILL
    assert 0 < marks(path) < 84
    told = []
    f.run_slowly(path, tell=told.append)
    assert "of 84 chunks are written and sound" in told[0]
    assert f.contents(path) == undisturbed


@pytest.mark.long
def test_twenty_kills(tmp_path, undisturbed):
    rng = random.Random(1)
    path = tmp_path / "a"
    written = [0]
    for _ in range(20):
        assert killed(path, 0.02 * rng.random())[0] == -signal.SIGKILL
        written.append(marks(path))
    assert written == sorted(written) and written[-1] < 84  # nothing is lost, none is idle
    f.run_slowly(path)
    assert f.contents(path) == undisturbed


@pytest.mark.parametrize("damage", ["flip", "cut", "gone", "no mark", "half a mark", "partial"])
def test_damaged_chunks_are_computed_again(tmp_path, finished, undisturbed, damage):
    path = shutil.copytree(finished, tmp_path / "a")
    chunk, mark = path / "value" / "c" / "3" / "1", path / "done" / "c" / "7"
    content = chunk.read_bytes()
    if damage == "flip":
        chunk.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    elif damage == "cut":
        chunk.write_bytes(content[: len(content) // 2])
    elif damage == "gone":
        chunk.unlink()
    elif damage == "no mark":
        mark.unlink()
    elif damage == "half a mark":
        mark.write_bytes(mark.read_bytes()[:3])
    else:
        (chunk.parent / "1.0123.partial").write_bytes(content)
    calls = []
    f.run_slowly(path, progress=calls.append)
    # and the three with a member that failed, which is tried again
    assert len(calls) == 3 + (damage != "partial")
    assert f.contents(path) == undisturbed


FIXED = ("x/c/0", "x/zarr.json", "value/zarr.json", "checksums.json")


@pytest.mark.parametrize("file", [*FIXED, "value/c/3/1"])
@pytest.mark.parametrize("damage", ["gone", "flip"])
def test_a_damaged_store_is_not_loaded_but_mended(tmp_path, finished, undisturbed, file, damage):
    path = shutil.copytree(finished, tmp_path / "a")
    content = (path / file).read_bytes()
    if damage == "gone":
        (path / file).unlink()
    else:
        (path / file).write_bytes(content[:-9] + bytes([content[-9] ^ 1]) + content[-8:])
    with pytest.raises(
        InputError, match=r"a is damaged: .*(json|/c/0|chunks \(10\)).*same command"
    ):
        study.load(path)
    f.run_slowly(path)
    assert f.contents(path) == undisturbed
    assert study.load(path).sizes["x"] == 28


@pytest.mark.parametrize("damage", ["gone", "flip"])
def test_damaged_samples_are_not_loaded_but_drawn_again(tmp_path, damage):
    """The column z of 6 samples, in two chunks; each is written with the block x = y = 0 of its."""
    path, g = tmp_path / "a", f.grid(2, 2, samples=6)
    policy = {"outputs": (study.Output("value"),), "kind": "host", "chunk": 12}

    def echo(p):
        return {"value": p["z"] + p["x"]}

    study.run(echo, g, path, **policy)
    before, chunk = f.contents(path), path / "z" / "c" / "1"
    content = chunk.read_bytes()
    if damage == "gone":
        chunk.unlink()
    else:
        chunk.write_bytes(content[:20] + bytes([content[20] ^ 1]) + content[21:])
    with pytest.raises(InputError, match=r"1 of 2 chunks \(1\) are not as they were written"):
        study.load(path)
    blocks = []
    study.run(echo, g, path, **policy, progress=blocks.append)
    assert len(blocks) == 1 and f.contents(path) == before
    np.testing.assert_array_equal(study.load(path).z, g.samples.draw(0, 6)["z"])


def test_whatever_reads_a_damaged_chunk_is_told(tmp_path):
    """Any reader of Zarr: the chunk has a checksum of its own."""
    import zarr

    study.run(f.waves, f.grid(), tmp_path / "a", outputs=f.OUTPUTS)
    chunk = tmp_path / "a" / "sum" / "c" / "0" / "0"
    content = chunk.read_bytes()
    chunk.write_bytes(content[:20] + bytes([content[20] ^ 1]) + content[21:])
    with pytest.raises(ValueError, match="checksum"):
        zarr.open_group(str(tmp_path / "a"), mode="r")["sum"][:]


def flaky(p):
    """Fails where there is no file `mended` in the folder of the run."""
    if p["x"] > 1 and not Path("mended").exists():
        raise RuntimeError(f"no\nnumber at {p['x']:g}")
    return {"value": p["x"] + p["y"]}


def test_errors_keep_their_text_and_are_tried_again(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    policy = {"outputs": f.SLOWLY, "kind": "host", "chunk": 5}
    found = study.run(flaky, f.grid(), "a", **policy)
    assert found.attrs["errors"]["RuntimeError: no number at 1.5"] == 5
    assert sum(found.attrs["errors"].values()) == (found.outcome == 2).sum() == 20
    Path("mended").touch()
    again = []
    found = study.run(flaky, f.grid(), "a", **policy, progress=again.append)
    assert len(again) == 4 and found.attrs["errors"] == {} and (found.outcome == 0).all()


def test_a_region_of_errors_that_comes_first_does_not_stop_a_study(tmp_path, monkeypatch):
    """As of several processes: the blocks come in another order."""
    module = sys.modules["jaxfric.study.run"]
    local = module._local
    monkeypatch.setattr(module, "_local", lambda task, todo: local(task, todo[::-1]))
    found = study.run(flaky, f.grid(), tmp_path / "a", outputs=f.SLOWLY, kind="host", chunk=10)
    np.testing.assert_array_equal(found.outcome == 2, (found.x > 1).broadcast_like(found.outcome))


@pytest.mark.parametrize("chunk", [1, 30])
def test_nothing_but_errors_stops_a_study(tmp_path, chunk):
    """Nothing is kept, so that the mended function may begin anew."""
    calls = []

    def broken(p):
        calls.append(p)
        raise KeyError("vlaue")

    policy = {"outputs": f.SLOWLY, "kind": "host", "chunk": chunk}
    with pytest.raises(
        InputError, match=r"the first .* all failed, with KeyError: 'vlaue'"
    ) as told:
        study.run(broken, f.grid(20, 5), tmp_path / "a", **policy)
    text = str(told.value)
    assert calls[0] == {"x": 0, "y": 0} and " at x = 0, y = 0; " in text
    assert "Correct the function" in text
    assert len(calls) < 35 and not (tmp_path / "a").exists()


def test_a_file_system_without_locks(tmp_path, monkeypatch):
    """It is not another run that holds the store."""
    import fcntl

    def flock(*_):
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(fcntl, "flock", flock)
    told = []
    study.run(f.waves, f.grid(), tmp_path / "a", outputs=f.OUTPUTS, tell=told.append)
    assert "has no locks (No locks available)" in told[0]


@pytest.mark.parametrize(
    ("out", "words"),
    [
        ("ftp://host/a.zarr", "no store at ftp://; give a folder, or one of s3://"),
        (Path("s3://bucket/a.zarr"), "lost a slash"),
    ],
)
def test_urls_that_are_refused(tmp_path, monkeypatch, out, words):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=words):
        study.run(f.waves, f.grid(), out, outputs=f.OUTPUTS)
    assert not list(tmp_path.iterdir())


def test_one_writer_at_a_time_whose_interrupt_leaves_a_store(tmp_path, undisturbed):
    path = tmp_path / "a"

    def write():
        with pytest.raises(InputError, match="written by another run"):
            f.run_slowly(path)

    code, error = killed(path, 0.1, signal.SIGINT, write)
    assert code != 0 and "KeyboardInterrupt" in error
    f.run_slowly(path)
    assert f.contents(path) == undisturbed


def test_a_full_disk(tmp_path, undisturbed, monkeypatch):
    path = tmp_path / "a"
    write, count = Store.write, [0]

    def full(self, number, found):
        count[0] += 1
        if count[0] > 9:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "x")
        write(self, number, found)

    monkeypatch.setattr(Store, "write", full)
    with pytest.raises(study.Stopped, match=r"No space left.*9 of 84 chunks.*same command"):
        f.run_slowly(path)
    monkeypatch.undo()
    f.run_slowly(path)
    assert f.contents(path) == undisturbed


def test_a_disk_that_is_truly_full(tmp_path, undisturbed):
    disk = tmp_path / "disk"
    disk.mkdir()
    made = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=300k", "tmpfs", disk], capture_output=True
    )
    if made.returncode:
        pytest.skip("no file system can be mounted here")
    try:
        with pytest.raises(study.Stopped, match="No space left"):
            f.run_slowly(disk / "a")
        subprocess.run(["mount", "-o", "remount,size=8m", disk], check=True)
        f.run_slowly(disk / "a")
        assert f.contents(disk / "a") == undisturbed
    finally:
        subprocess.run(["umount", disk], check=False)


def test_other_stores_are_refused(tmp_path):
    g = f.grid()
    study.run(f.waves, g, tmp_path / "a", outputs=f.OUTPUTS)
    before = f.contents(tmp_path / "a")
    with pytest.raises(InputError, match=r"another study, which differs in axes\.x"):
        study.run(f.waves, f.grid(6), tmp_path / "a", outputs=f.OUTPUTS)
    with pytest.raises(InputError, match="differs in dtype"):
        study.run(f.waves, g, tmp_path / "a", outputs=f.OUTPUTS, dtype="float32", chunk=9)
    (tmp_path / "b").mkdir()
    (tmp_path / "c").write_text("no store")
    for name in "bc":
        with pytest.raises(InputError, match="is not the store of a study"):
            study.run(f.waves, g, tmp_path / name, outputs=f.OUTPUTS)
    with pytest.raises(InputError, match="no such store"):
        study.load(tmp_path / "nothing")
    assert f.contents(tmp_path / "a") == before and not list((tmp_path / "b").iterdir())


def clash(name):
    """An output whose further dimension is called `name`."""
    return study.Output("row", dims=(study.values(name, [0.0, 1.0, 2.0]),))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"chunk": 0}, "chunk is 0"),
        ({"dtype": "float16"}, "float16"),
        ({"outputs": (study.Output("summ"),)}, "no output 'summ'"),
        ({"outputs": (study.Output("row"),)}, "has shape"),
        ({"outputs": (study.Output("x"),)}, "both a parameter and an output"),
        ({"outputs": (study.Output("done"),)}, "every store has"),
        ({"outputs": (*f.OUTPUTS[:3], clash("sum"))}, "'sum' is a dimension of an output and"),
        ({"outputs": (*f.OUTPUTS[:3], clash("x"))}, "'x' is a dimension of an output and"),
        ({"kind": "host"}, "outputs listed"),
    ],
)
def test_refused(tmp_path, arguments, words):
    with pytest.raises(InputError, match=words):
        study.run(f.waves, f.grid(), tmp_path / "a", **arguments)


def test_what_a_store_says_of_itself(tmp_path):
    study.run(f.waves, f.grid(), tmp_path / "a", outputs=f.OUTPUTS, toml="a = 1\n")
    found = attributes(Directory(tmp_path / "a"))
    assert found["toml"] == "a = 1\n" and found["members"] == 35
