"""The command `carigs` and its subcommands."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import warnings
from types import SimpleNamespace

import pytest
import yaml
from processes import started

from carigs.cli import plan, run, settings, sweep
from carigs.cli.main import COMMANDS, main
from carigs.config import snakemake_config, split_overrides
from carigs.errors import CarigsWarning, SettingsError


def test_help_lists_every_command_and_each_has_an_example(capsys):
    assert main(["--help"]) == 0
    overview = capsys.readouterr().out
    for command in COMMANDS:
        assert f"  {command} " in overview
        with pytest.raises(SystemExit) as ended:
            main([command, "--help"])
        assert ended.value.code == 0
        assert f"  carigs {command} " in capsys.readouterr().out


@pytest.mark.parametrize("arguments", [[], ["walk"]])
def test_a_wrong_command_is_a_usage_error(arguments, capsys):
    assert main(arguments) == 2
    assert "usage: carigs" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["--help", "mesh --help", "convert --help"])
def test_the_start_imports_neither_torch_nor_snakemake(command):
    code = (
        "import sys\n"
        "from carigs.cli.main import main\n"
        "try:\n"
        "    main(sys.argv[1:])\n"
        "except SystemExit:\n"
        "    pass\n"
        "assert not {'torch', 'snakemake'} & set(sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, *command.split()], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.fixture
def commands(monkeypatch):
    """The commands that would have been run; those with gamma=0.2 fail."""
    seen: list[list[str]] = []

    def fake(command):
        seen.append(command)
        return int(snakemake_config(["gamma=0.2"])[0] in command)

    monkeypatch.setattr(run, "_exit_code", fake)
    return seen


def test_options_reach_snakemake_and_its_failure_the_exit_code(commands, monkeypatch):
    monkeypatch.setenv("CARIGS_DATA", "/data")
    assert run.main(["study=ict", "-n", "gamma=0.1", "--cores", "3", "--target", "table", "--", "--keep-going"]) == 0
    (command,) = commands
    assert command[command.index("--cores") + 1] == "3"
    assert command[-4:] == ["--config", *snakemake_config(["study=ict", "gamma=0.1"]), "--", "table"]
    assert {"--dry-run", "--keep-going"} <= {*command}
    assert run.main(["gamma=0.2"]) == 1


def test_a_plan_runs_nothing(commands, monkeypatch):
    planned = []
    monkeypatch.setattr(plan, "main", lambda arguments: planned.append(arguments) or 0)
    assert run.main(["gamma=0.1", "--plan", "--cores", "3"]) == 0
    assert (commands, planned) == ([], [["gamma=0.1", "--remaining", "--cores", "3"]])


def test_a_subject_that_lacks_its_folder_is_one_line(commands, capsys):
    assert main(["run", "study=own"]) == 1
    assert capsys.readouterr().err == "carigs: capture.folder must be set when capture.source is folder\n"
    assert main(["run", "study=own", "capture.folder=a", "capture.head_model=a.npz"]) == 0
    assert len(commands) == 1


def test_cores_of_this_machine_do_not_limit_jobs_elsewhere(commands):
    run.main([])
    run.main(["--profile", "slurm"])
    here, elsewhere = commands
    assert here[here.index("--cores") + 1] == "all"
    assert elsewhere[elsewhere.index("--workflow-profile") + 1] == "slurm"
    assert "--cores" not in elsewhere


SNAKEMAKE = """
import time
try:
    print("start", flush=True)
    time.sleep(60)
except KeyboardInterrupt:
    time.sleep(1)  # longer than subprocess.run waits
    print("jobs are cancelled", flush=True)
"""
RUN = """
import sys
from carigs.cli.run import _exit_code
try:
    _exit_code([sys.executable, "-c", sys.argv[1]])
except KeyboardInterrupt:
    print("end")
"""


def test_an_interrupt_leaves_snakemake_the_time_to_cancel_its_jobs():
    command = [sys.executable, "-c", RUN, SNAKEMAKE]
    with started(command, stdout=subprocess.PIPE, start_new_session=True) as process:
        assert process.stdout.readline() == "start\n"
        os.killpg(process.pid, signal.SIGINT)
        assert process.communicate(timeout=60)[0].splitlines() == ["jobs are cancelled", "end"]


def test_a_sweep_is_one_run_that_goes_on_after_failures(commands):
    assert sweep.main(["gamma=0.1,0.25", "study=toy", "capture.toy.seed=1,2", "--cores", "3"]) == 0
    (command,) = commands
    config = snakemake_config(["study=toy"], ["gamma=0.1,0.25", "capture.toy.seed=1,2"])
    assert command[-5:] == ["--config", *config, "--", "sweep"]
    assert "--keep-going" in command


def test_the_combinations_that_failed_are_named_in_one_line(monkeypatch, tmp_path, capsys):
    """A training with its gamma fails for one combination, a capture for all with its seed."""
    monkeypatch.chdir(tmp_path)

    def fail(command):
        for file in ("1/log/train/toy,gamma=0.1,surfhead", "2/log/capture/toy"):
            record = tmp_path / f"results/toy+capture.toy.seed={file}.json"
            record.parent.mkdir(parents=True)
            record.write_text('{"finished": null, "outputs": {}}')
        return 1

    monkeypatch.setattr(run, "_exit_code", fail)
    assert sweep.main(["gamma=0.1,0.2", "capture.toy.seed=1,2"]) == 1
    named = "gamma=0.1 capture.toy.seed=1; gamma=0.1 capture.toy.seed=2; gamma=0.2 capture.toy.seed=2"
    lines = [line for line in capsys.readouterr().err.splitlines() if "without weights" not in line]
    assert lines[-1] == f"carigs: failed: {named}; the others are kept for the next run"
    assert len(lines) == 3


def test_a_sweep_over_what_a_study_needs_says_which_weights_are_missing(monkeypatch, tmp_path, capsys):
    """Without a value of the swept key the settings would not be complete."""
    monkeypatch.chdir(tmp_path)
    for name in ("CARIGS_WEIGHTS", "HF_HUB_CACHE"):
        monkeypatch.delenv(name, raising=False)
    for name in ("HF_HOME", "TORCH_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name))
    monkeypatch.setattr(run, "_exit_code", lambda command: 0)
    swept = ["capture.source=folder", "capture.head_model=m.npz", "capture.folder=a,b", "metrics.embeddings=[clip]"]
    assert sweep.main(swept) == 0
    assert "these columns stay empty: CLIP-I, CLIP-D, CLIP-C" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("override", "named"),
    [
        ("sweep.metrics=[psnr,beauty]", "sweep.metrics: beauty is unknown; known: "),
        ("sweep.level=0.2", "sweep.level=0.2 is not rendered; rendered: 0, 0.1, 0.15, 0.25"),
        ("tabulate.reference=nobody", "tabulate.reference=nobody is no variant; known: "),
    ],
)
def test_what_the_table_of_a_sweep_would_refuse_is_refused_before_it_starts(commands, override, named):
    with pytest.raises(SettingsError, match=re.escape(named)):
        sweep.main(["gamma=0.1,0.25", "study.levels=[0.1,0.15]", override])
    assert not commands


@pytest.mark.slow
def test_any_number_of_overrides_reaches_snakemake(commands, monkeypatch, tmp_path):
    """Linux allows 131072 bytes for the command of a job; it holds the overrides, quoted twice."""
    monkeypatch.chdir(tmp_path)
    prompt = f"metrics.edit_prompt={'a' * 2000}"
    overrides = [override for seed in range(60) for override in (f"capture.toy.seed={seed}", prompt)]
    assert run.main(overrides) == 0
    (line,) = (word.removeprefix("hydra=") for word in commands[0] if word.startswith("hydra="))
    assert line.startswith("@results/") and list(split_overrides(line)) == overrides
    with pytest.raises(SettingsError, match="hydra=@FILE"):
        split_overrides(" ".join(overrides))


@pytest.mark.parametrize(
    ("command", "arguments", "named"),
    [
        ("run", ["train.iterations=0"], "train.iterations=0 must lie in [1, 1000000000]"),
        ("run", ["gamma=0.1,0.2"], "carigs sweep"),
        ("sweep", ["gamma=0.1,nan"], "gamma=nan"),
        ("sweep", ["gamma=["], "gamma=["),
        ("sweep", ["capture.toy.seed=1,2", "capture.toy.sed=1,2"], "capture.toy.sed"),
        ("sweep", ["capture.toy.seed=1,2", "train.iterations=3,0"], "train.iterations=0 must lie in"),
        ("sweep", ["gamma=0.1"], "carigs run"),
        ("sweep", ["capture.toy.seed=range(20000)"], "at most 10000 combinations"),
        ("settings", ["study=tyo"], "study=tyo"),
    ],
)
def test_mistakes_are_one_line_before_work_starts(command, arguments, named, commands, capsys):
    assert main([command, *arguments]) == 1
    error = capsys.readouterr().err
    assert error.startswith("carigs: ") and error.count("\n") == 1 and named in error
    assert commands == []


@pytest.mark.parametrize("command", COMMANDS)
def test_a_warning_is_one_line(command, monkeypatch, capsys):
    def warn(arguments):
        warnings.warn("the surface\nfolds", CarigsWarning, stacklevel=1)
        return 3

    monkeypatch.setitem(sys.modules, f"carigs.cli.{command}", SimpleNamespace(main=warn))
    assert main([command]) == 3
    assert capsys.readouterr().err == "carigs: warning: the surface\\nfolds\n"


def test_settings_are_shown_as_a_whole_or_by_section(capsys):
    assert settings.main(["gamma=0.2"]) == 0
    shown = yaml.safe_load(capsys.readouterr().out)
    assert shown["gamma"] == 0.2 and "gamma" not in shown["exaggerate"]  # what is derived cannot be set
    assert main(["settings", "--section", "train", "variant=surfhead"]) == 1
    assert "study.variants" in capsys.readouterr().err
    assert settings.main(["--section", "train", "train.iterations=40"]) == 0
    assert yaml.safe_load(capsys.readouterr().out)["iterations"] == 40


def test_settings_are_those_of_a_subject_of_the_study_and_say_which(capsys, monkeypatch):
    monkeypatch.setenv("CARIGS_DATA", "/data")
    for options, subject, source in (([], "ict_s1", "folder"), (["--subject", "toy"], "toy", "toy")):
        assert settings.main(["study=ict", "--section", "capture", *options]) == 0
        shown = capsys.readouterr().out
        assert shown.startswith(f"# subject {subject}, ") and yaml.safe_load(shown)["source"] == source
    assert main(["settings", "--subject", "tyo"]) == 1
    assert "subject=tyo is unknown; known: " in capsys.readouterr().err


def test_settings_are_shown_as_a_variant_has_them(capsys):
    assert settings.main(["--variant", "surfhead", "--section", "train", "train.iterations=40"]) == 0
    shown = yaml.safe_load(capsys.readouterr().out)
    assert (shown["gtstar_probability"], shown["iterations"]) == (0.0, 40)
    assert main(["settings", "--variant", "surfhaed"]) == 1
    assert "variant=surfhaed is unknown; known: " in capsys.readouterr().err
