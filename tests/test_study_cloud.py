"""Stores in an object store: a real server of S3's protocol, on this machine."""

import json
import os
import subprocess
import sys
import time

import numpy as np
import pytest
import study_functions as f

from jaxfric import InputError, study
from jaxfric.study import place as places
from jaxfric.study.place import place_of

pytest.importorskip("zarr")
pytest.importorskip("xarray")
obstore = pytest.importorskip("obstore")
server = pytest.importorskip("moto.server")
pytest.importorskip("flask_cors")


@pytest.fixture(scope="module")
def bucket():
    """An empty bucket, and the environment by which it is found."""
    import boto3

    running = server.ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    running.start()
    url = "http://{}:{}".format(*running.get_host_and_port())
    known = {
        "AWS_ENDPOINT_URL": url,
        "AWS_ACCESS_KEY_ID": "a",
        "AWS_SECRET_ACCESS_KEY": "b",
        "AWS_REGION": "us-east-1",
    }
    with pytest.MonkeyPatch.context() as patch:
        for name, value in known.items():
            patch.setenv(name, value)
        keys = {"aws_access_key_id": "a", "aws_secret_access_key": "b"}
        client = boto3.client("s3", endpoint_url=url, region_name="us-east-1", **keys)
        client.create_bucket(Bucket="bucket")
        yield "s3://bucket"
    running.stop()


def contents(url):
    place = place_of(url)
    return {name: place.read(name) for name in place._below(None) if name != ".lock"}


@pytest.fixture(scope="module")
def kept(bucket):
    """A study in the bucket, which every test leaves whole; and what its run gave."""
    url = f"{bucket}/here/a.zarr"
    return url, f.run_slowly(url, 4)


def test_a_store_in_a_bucket_is_that_of_a_folder(kept, tmp_path):
    url, found = kept
    f.run_slowly(tmp_path / "a", 4)
    here = {n: (tmp_path / "a" / n).read_bytes() for n in f.contents(tmp_path / "a")}
    assert contents(url) == here
    assert found.identical(study.load(tmp_path / "a")) and not place_of(url).read(".lock")


def test_a_killed_run_in_a_bucket_goes_on(bucket, tmp_path, monkeypatch):
    """Its lock is still there: it is taken over when nobody renews it."""
    monkeypatch.setattr(places, "_ABANDONED", 0.3)
    url = f"{bucket}/killed.zarr"
    command = [sys.executable, f.__file__, "slowly", url, "12"]
    run = subprocess.Popen(command, env=os.environ | f.PAUSED, stderr=subprocess.PIPE)
    place = place_of(url)
    while len(place.names("done/c")) < 3 and run.poll() is None:
        time.sleep(0.02)
    run.kill()
    run.wait(30)
    assert place.read(".lock") and 3 <= len(place.names("done/c")) < 36
    told = []
    f.run_slowly(url, 12, tell=told.append)
    assert "another run has locked" in told[0] and "chunks are written and sound" in told[1]
    f.run_slowly(tmp_path / "a", 12)
    assert sorted(contents(url)) == sorted(f.contents(tmp_path / "a"))


def test_one_run_writes_a_bucket(kept, monkeypatch):
    """A lock that is renewed is another run's."""
    monkeypatch.setattr(places, "_BEAT", 0.05)
    url, _ = kept
    with place_of(url).lock(print), pytest.raises(InputError, match="written by another run"):
        f.run_slowly(url, 4)
    study.load(url)


@pytest.mark.parametrize("damage", ["coordinate", "chunk"])
def test_damage_in_a_bucket(kept, damage):
    url, _ = kept
    place, whole = place_of(url), contents(url)
    place.remove("x/c/0" if damage == "coordinate" else "value/c/0/1")
    with pytest.raises(InputError, match="is damaged"):
        study.load(url)
    f.run_slowly(url, 4)
    assert contents(url) == whole


def test_what_an_object_store_refuses(bucket, monkeypatch):
    with pytest.raises(InputError, match=r"s3://nobucket/a\.zarr: .*(NoSuchBucket|not exist)"):
        f.run_slowly("s3://nobucket/a.zarr", 4)
    with pytest.raises(InputError, match="no such store"):
        study.load(f"{bucket}/nothing.zarr")
    write, count = places.Objects.write, [0]

    def failing(self, name, content):
        count[0] += 1
        if count[0] > 20:
            raise OSError(5, "the service is unavailable", self.shown)
        write(self, name, content)

    monkeypatch.setattr(places.Objects, "write", failing)
    with pytest.raises(study.Stopped, match=r"service is unavailable; \d+ of 12.*same command"):
        f.run_slowly(f"{bucket}/failing.zarr", 4)
    monkeypatch.undo()
    assert np.isfinite(f.run_slowly(f"{bucket}/failing.zarr", 4)["value"]).sum() == 18


def test_without_obstore(monkeypatch):
    monkeypatch.setitem(sys.modules, "obstore", None)
    with pytest.raises(InputError, match=r'pip install "jaxfric\[cloud\]"'):
        place_of("s3://b/a.zarr")


def test_beats_are_told_apart():
    assert json.loads(places._beat("a", 1)) == {"owner": "a", "beat": 1}
