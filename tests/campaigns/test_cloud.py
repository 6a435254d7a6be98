"""Experiments in a bucket of a real server that speaks S3, on the loopback address."""

import os
import time
import urllib.request
from pathlib import Path

import polars as pl
import pytest
from campaign_work import here
from recordings import write_small

from steelyard.campaigns import inputs
from steelyard.campaigns.inputs import file_system, local_experiment
from steelyard.campaigns.items import find_items
from steelyard.campaigns.rows import TABLE
from steelyard.campaigns.run import campaign
from steelyard.errors import InputError

pytestmark = [pytest.mark.integration, pytest.mark.filterwarnings("ignore")]
KEY, SECRET = "AKIAXK7KEY", "xk7verysecret"
TWO_STEP = "two-step"


@pytest.fixture(scope="module")
def endpoint():
    pytest.importorskip("s3fs")
    server = pytest.importorskip("moto.server")
    running = server.ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    running.start()
    _, port = running.get_host_and_port()
    yield f"http://127.0.0.1:{port}"
    running.stop()


def post(address, data=b""):
    kind = {"Content-Type": "text/plain"}
    request = urllib.request.Request(address, data=data, headers=kind, method="POST")
    urllib.request.urlopen(request).close()


@pytest.fixture
def bucket(endpoint, monkeypatch, tmp_path):
    """An empty one, and a place of its own for copies."""
    keys = {
        "AWS_ENDPOINT_URL": endpoint,
        "AWS_ACCESS_KEY_ID": KEY,
        "AWS_SECRET_ACCESS_KEY": SECRET,
        "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_EC2_METADATA_DISABLED": "true",
        "AWS_CONFIG_FILE": str(tmp_path / "none"),
    }
    for name, value in keys.items():
        monkeypatch.setenv(name, value)
    copies = tmp_path / "copies"
    copies.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(copies))
    post(f"{endpoint}/moto-api/reset")
    system, _ = file_system("s3://days")
    system.mkdir("days")
    return system, copies


def put(system, folder, name):
    system.put(str(write_small(folder / name).parent), f"days/{name}", recursive=True)


@pytest.mark.slow
def test_a_bucket_gives_the_numbers_of_its_files_and_nothing_stays(bucket, tmp_path):
    system, copies = bucket
    for name in ("a", "deep/b"):
        put(system, tmp_path / "data", name)
    there = campaign("s3://days", tmp_path / "out", TWO_STEP, engine=here)
    campaign(tmp_path / "data", tmp_path / "local", TWO_STEP, engine=here)
    tables = [pl.read_parquet(tmp_path / each / TABLE) for each in ("out", "local")]
    assert tables[0].drop("seconds", "path").equals(tables[1].drop("seconds", "path"))
    paths = tables[0]["path"].unique().sort().to_list()
    assert paths == [f"s3://days/{name}/experiment.yaml" for name in ("a", "deep/b")]
    assert list(copies.iterdir()) == []
    written = [path for path in there.folder.rglob("*") if path.is_file()]
    assert not [path for path in written if SECRET.encode() in path.read_bytes()]
    again = campaign("s3://days", tmp_path / "out", TWO_STEP, engine=here)
    assert again.unchanged == 2
    # What comes later is seen by the same process.
    put(system, tmp_path / "data", "c")
    assert [item.name for item in find_items(["s3://days"])] == ["a", "c", "deep/b"]


@pytest.mark.parametrize("url", ["s3://none", "s3://none/a/experiment.yaml", "s3://days/x*"])
def test_a_bucket_that_is_not_there_is_one_sentence(bucket, url, tmp_path):
    with pytest.raises(InputError, match=f"{url[:9]}.*expected") as error:
        campaign(url, tmp_path / "out", TWO_STEP, engine=here)
    assert "\n" not in str(error.value)
    assert not (tmp_path / "out").exists()


def test_rights_that_are_missing_are_one_sentence(bucket, endpoint, tmp_path):
    system, _ = bucket
    put(system, tmp_path / "data", "a")
    limit = f"{endpoint}/moto-api/reset-auth"
    post(limit, b"0")
    try:
        with pytest.raises(
            InputError, match="s3://days: expected files that can be listed"
        ) as error:
            campaign("s3://days", tmp_path / "out", TWO_STEP, engine=here)
    finally:
        post(limit, b"inf")
    assert "\n" not in str(error.value)
    assert SECRET not in str(error.value)


def test_credentials_in_a_url_are_refused_and_not_repeated():
    with pytest.raises(InputError, match="without user and password") as error:
        find_items([f"https://me:{SECRET}@host/days"])
    assert SECRET not in str(error.value)


def test_copies_of_killed_processes_go_and_others_stay(bucket, tmp_path):
    system, copies = bucket
    put(system, tmp_path / "data", "a")
    left = copies / f"{inputs._COPIES}left"
    left.mkdir()
    (left / inputs._HELD).touch()
    (left / "large").write_bytes(b"x")
    with local_experiment("s3://days/a/experiment.yaml") as first:
        assert left.exists(), "it may have just begun"
        old = time.time() - 1000
        for each in copies.iterdir():
            os.utime(each, (old, old))
        with local_experiment("s3://days/a/experiment.yaml"):
            assert not left.exists()
            assert first.is_file()
    assert list(copies.iterdir()) == []


def test_what_does_not_fit_on_the_disk_is_not_begun(bucket, tmp_path, monkeypatch):
    system, copies = bucket
    put(system, tmp_path / "data", "a")
    free = type("Usage", (), {"free": 10})
    monkeypatch.setattr("shutil.disk_usage", lambda path: free)
    found = campaign("s3://days", tmp_path / "out", TWO_STEP, engine=here)
    assert found.counts == {"lost": 1}
    assert "do not fit on the disk" in found.problems[0]
    assert not [path for path in Path(copies).rglob("*") if path.is_file()]
