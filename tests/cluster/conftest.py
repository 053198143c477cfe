"""The miniature study as one machine makes it, and what tests of clusters need."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from cluster.ball_study import HYDRA, NAME, contents, write_ball_study
from cluster.slurm_cluster import SlurmCluster, slurm_cluster
from project import Project, copy_project, shared_kernels


@pytest.fixture(scope="session")
def project(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Project]:
    """A copy of the project with the miniature study."""
    project = copy_project(tmp_path_factory.mktemp("cluster"))
    write_ball_study(project)
    with shared_kernels():
        yield project


@pytest.fixture(scope="session")
def local_results(project: Project, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The study made by local jobs in another folder."""
    folder = tmp_path_factory.mktemp("local")
    done = project.snakemake("--cores", "2", "--directory", str(folder), "table", hydra=HYDRA)
    assert done.returncode == 0, done.stdout + done.stderr
    return contents(folder / "results" / NAME)


@pytest.fixture(scope="session")
def slurm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SlurmCluster]:
    """A Slurm cluster of two nodes, and an environment in which commands use it."""
    with slurm_cluster(tmp_path_factory.mktemp("slurm")) as cluster, pytest.MonkeyPatch.context() as patch:
        for name, value in cluster.environment().items():
            patch.setenv(name, value)
        yield cluster
