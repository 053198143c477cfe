"""Runs and sweeps: `python -m carigs -m gamma=0.1,0.15,0.2,0.25` has Snakemake make one point after the other.

Arguments are Hydra's.  Snakemake's own come from its profiles, e.g. the environment variable SNAKEMAKE_PROFILE.
"""

from __future__ import annotations

import shlex
import subprocess
import sys

import hydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from carigs.config import CONF


def main() -> None:
    """Run Snakemake at every point; a point that fails does not keep the others from running."""
    failed: list[str] = []

    @hydra.main(config_path=str(CONF), config_name="config", version_base="1.3")
    def point(_: DictConfig) -> None:
        overrides = shlex.join(HydraConfig.get().overrides.task)
        # Snakemake takes quotes off the ends of a value; a blank there keeps ours.
        targets = ("--config", f"hydra={overrides} ", "--", "reproduce", "table")
        command = [sys.executable, "-m", "snakemake", "--cores", "all", *targets]
        if subprocess.run(command, cwd=CONF.parent).returncode:
            failed.append(" ".join(HydraConfig.get().overrides.task) or "the default point")

    point()
    if failed:
        sys.exit(f"carigs: failed: {'; '.join(failed)}")


if __name__ == "__main__":
    main()
