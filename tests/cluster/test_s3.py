"""A study with its results on S3, in a bucket of a server on this machine; and a plan for pods that use the bucket."""

from __future__ import annotations

import os
from importlib.util import find_spec

import pytest
from cluster.ball_study import HYDRA, NAME, contents
from project import Project

PLUGINS = ("moto", "snakemake_executor_plugin_kubernetes", "snakemake_storage_plugin_s3")
MISSING = [name for name in PLUGINS if not find_spec(name)]
pytestmark = [
    pytest.mark.s3,
    pytest.mark.slow,
    pytest.mark.skipif(bool(MISSING), reason=f"no {', '.join(MISSING)}; try make cluster"),
]
STORAGE = ("--default-storage-provider", "s3", "--default-storage-prefix", "s3://carigs/here")
KEYS = {"aws_access_key_id": "test", "aws_secret_access_key": "test", "region_name": "us-east-1"}


@pytest.fixture(scope="module")
def endpoint():
    """Address of an S3 server, which Snakemake uses."""
    from moto.server import ThreadedMotoServer

    running = ThreadedMotoServer("127.0.0.1", 0, verbose=False)
    running.start()
    address = "http://{}:{}".format(*running.get_host_and_port())
    settings = {"ENDPOINT_URL": address, "ACCESS_KEY": "test", "SECRET_KEY": "test"}
    with pytest.MonkeyPatch.context() as patch:
        for name, value in settings.items():
            patch.setenv(f"SNAKEMAKE_STORAGE_S3_{name}", value)
        yield address
    running.stop()


@pytest.fixture(scope="module")
def objects(endpoint: str, project: Project) -> dict[str, bytes]:
    """The objects that a run has written."""
    import boto3

    done = project.snakemake("--cores", "2", *STORAGE, "table", hydra=HYDRA)
    assert done.returncode == 0, done.stdout + done.stderr
    bucket = boto3.resource("s3", endpoint_url=endpoint, **KEYS).Bucket("carigs")
    return {entry.key.removeprefix("here/"): entry.get()["Body"].read() for entry in bucket.objects.all()}


def test_the_results_are_those_on_a_disk(objects, local_results, tmp_path):
    for key, content in objects.items():
        (tmp_path / key).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / key).write_bytes(content)
    assert contents(tmp_path / "results" / NAME) == local_results


def test_nothing_is_left_to_do(objects, project):
    again = project.snakemake("--cores", "2", "--dry-run", *STORAGE, "table", hydra=HYDRA)
    assert "Nothing to be done" in again.stdout


def test_nothing_half_written_is_left(objects, project):
    storage = project.root / ".snakemake/storage"
    assert not (project.root / "results").exists()
    names = [*objects, *(name for _, _, files in os.walk(storage) for name in files)]
    assert not [name for name in names if ".part" in name]


def test_snakemake_plans_a_study_with_the_profile_for_kubernetes(endpoint, project):
    arguments = ("--workflow-profile", "kubernetes", "--default-storage-prefix", "s3://carigs/pods")
    done = project.snakemake("--dry-run", *arguments, "table", hydra=HYDRA)
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"s3://carigs/pods/results/{NAME}/table/gamma=0.25.csv" in done.stdout
