"""A study is killed and disturbed at random; in the end its results are those of an undisturbed run, byte for byte.

CARIGS_CHAOS is the number of kills (`make chaos`: 106), CARIGS_CHAOS_SEED the seed, which a failure names.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import time
from collections import Counter

import pytest
from chaos.disturbances import (
    EDITED,
    EDITS,
    KILLS,
    OTHER_SETTINGS,
    Run,
    disturb,
    edited,
    kill,
    outputs,
    processes_of,
    schedule,
    two_runs_with_other_settings,
)
from chaos.miniature_study import HYDRA, copy_miniature_study
from project import Project, shared_kernels

SEED = int(os.environ.get("CARIGS_CHAOS_SEED", "0"))
NUMBER_OF_KILLS = int(os.environ.get("CARIGS_CHAOS", "3"))
LITTER = ("*.part*", "*.lock", "*.checkpoint")
pytestmark = [pytest.mark.chaos, pytest.mark.slow]


def test_whatever_happens_the_results_are_the_same_bytes(tmp_path):
    project = copy_miniature_study(tmp_path / "project")
    with shared_kernels():
        chance, counts, started = random.Random(SEED), Counter(), time.time()
        events = schedule(NUMBER_OF_KILLS, chance)
        expected, of_other_settings, of_edits = undisturbed(project), {}, {}
        if EDITED.keys() & set(events):
            of_other_settings = undisturbed(project, OTHER_SETTINGS)
            for kind in EDITS:
                with edited(project, kind):
                    of_edits[kind] = undisturbed(project)
                    assert of_edits[kind] != expected, f"{kind} changes no result"
        for number, kind in enumerate(events):
            where = f"seed {SEED}, disturbance {number} ({kind})"
            print(f"{time.time() - started:.0f} s  {number}  {kind}", flush=True)
            if kind == "edit":
                done = kill("group", project, chance)
                edit = chance.choice([*EDITS])
                with edited(project, edit):
                    finish(project, of_edits[edit], f"{where}, {edit}")
                finish(project, expected, f"{where}, undone")
            elif kind == "two runs with other settings":
                done = two_runs_with_other_settings(project, chance) is None
                made = outputs(project)
                wrong = [file for file in made if made[file] not in (expected[file], of_other_settings[file])]
                assert not wrong, f"{where}: {wrong}"
                finish(project, expected, where)
            else:
                done = kill(kind, project, chance) if kind in KILLS else disturb(kind, project, chance)
                check_whole(project, expected, where)
            counts[kind if done else f"{kind}: too late or not possible"] += 1
            if len(outputs(project)) == len(expected):
                finish(project, expected, where)
                counts["completed studies"] += 1
                start_again(project)
        killed_while_compiling = project.root / "kernels"
        cache = {"NUMBA_CACHE_DIR": str(killed_while_compiling)} if killed_while_compiling.exists() else {}
        finish(project, expected, f"seed {SEED}, the end", **cache)
    print(json.dumps({**counts, "seconds": round(time.time() - started)}))


def undisturbed(project: Project, hydra: str = HYDRA) -> dict[str, bytes]:
    """What a run makes that nothing disturbs."""
    assert Run(project, hydra).wait(), (project.root / "output.log").read_text()
    made = outputs(project)
    start_again(project)
    return made


def start_again(project: Project) -> None:
    for name in ("results", ".snakemake"):
        shutil.rmtree(project.root / name, ignore_errors=True)


def check_whole(project: Project, expected: dict[str, bytes], where: str) -> None:
    """Every output that has its name has its content, too."""
    for file, content in outputs(project).items():
        assert expected.get(file) == content, f"{where}: {file} differs"


def finish(project: Project, expected: dict[str, bytes], where: str, **variables: str) -> None:
    """Complete the study; nothing is left over and no process goes on."""
    output = project.root / "output.log"
    output.unlink(missing_ok=True)
    assert Run(project, **variables).wait(), f"{where}: {output.read_text()}"
    assert outputs(project) == expected, where
    litter = [str(file) for pattern in LITTER for file in (project.root / "results").rglob(pattern)]
    assert not litter, f"{where}: {litter}"
    deadline = time.monotonic() + 15
    while processes := processes_of(project):
        assert time.monotonic() < deadline, f"{where}: {processes}"
        time.sleep(0.2)
