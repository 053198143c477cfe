"""What the repository says about itself: citation, changelog, forms of issues, entry of the workflow catalogue."""

from __future__ import annotations

import re
import tomllib

import pytest
import yaml
from docs.blocks import ROOT, command_lines, read_blocks
from docs.commands import unknown_keys

from carigs.cli.main import COMMANDS
from carigs.config import split_overrides

pytestmark = pytest.mark.docs
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
FORMS = [ROOT / f".github/ISSUE_TEMPLATE/{name}.yml" for name in ("bug", "capture")]


def load(file: str) -> dict:
    return yaml.safe_load((ROOT / file).read_text("utf-8"))


def test_the_citation_has_what_its_format_demands_and_agrees_with_pyproject():
    citation = load("CITATION.cff")
    assert {"cff-version", "message", "title", "authors"} <= citation.keys()
    assert (citation["title"], citation["version"]) == (PROJECT["name"], PROJECT["version"])
    assert (citation["license"], citation["type"]) == (PROJECT["license"], "software")
    authors = [author.get("name") for author in PROJECT.get("authors", ())] or ["carigs maintainers"]
    assert [author["name"] for author in citation["authors"]] == authors
    (paper,) = citation["references"]
    assert {"type", "title", "authors"} <= paper.keys()
    assert paper["url"] in (ROOT / "README.md").read_text("utf-8")


def test_the_changelog_has_the_version_of_pyproject():
    changelog = (ROOT / "CHANGELOG.md").read_text("utf-8")
    versions = re.findall(r"^## \[(.+?)\]", changelog, re.MULTILINE)
    assert versions[0] == "Unreleased" or versions[0] == PROJECT["version"]
    assert PROJECT["version"] in changelog


def test_the_changelog_names_all_commands_and_studies_and_settings_that_exist():
    changelog, _, _ = (ROOT / "CHANGELOG.md").read_text("utf-8").partition("### Changed")  # which names what is gone
    named = {*re.findall(r"`carigs ([a-z]+)`", changelog)}
    assert named == COMMANDS.keys() - {"settings"}
    settings = re.findall(r"`((?:train|study|exaggerate)\.\w+)`", changelog)
    assert len(settings) > 3 and unknown_keys(settings) == []
    (studies,) = re.findall(r"Studies ((?:`\w+`(?:, | and )?)+)", changelog)
    for study in re.findall(r"`(\w+)`", studies):
        assert (ROOT / f"conf/study/{study}.yaml").is_file()


@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.stem)
def test_the_forms_of_issues_ask_for_the_check_and_the_version(form):
    content = yaml.safe_load(form.read_text("utf-8"))
    assert {"name", "description", "body"} <= content.keys()
    fields = {field["id"]: field for field in content["body"]}
    assert len(fields) == len(content["body"])
    assert all(field["type"] in ("input", "textarea", "dropdown", "checkboxes") for field in fields.values())
    assert "carigs check" in str(fields["check"]) and "carigs --version" in str(fields["version"])
    assert fields["version"]["validations"]["required"]
    assert fields["version"]["attributes"]["placeholder"] == f"carigs {PROJECT['version']}"


def test_the_form_of_captures_needs_the_check():
    fields = {field["id"]: field for field in load(".github/ISSUE_TEMPLATE/capture.yml")["body"]}
    assert fields["check"]["validations"]["required"]
    (command,) = re.findall(r"`(carigs check [^`]+)`", fields["check"]["attributes"]["description"])
    assert "--sheet" in command


def test_the_entry_of_the_catalogue_names_a_profile_that_exists():
    usage = load(".snakemake-workflow-catalog.yml")["usage"]
    assert set(usage) == {"mandatory-flags", "software-stack-deployment", "report"}
    option, profile = usage["mandatory-flags"]["flags"].split()
    assert option == "--workflow-profile" and (ROOT / profile / "config.yaml").is_file()
    assert "environment.yml" in usage["mandatory-flags"]["desc"] and (ROOT / "environment.yml").is_file()
    # The catalogue finds workflows by these words.
    readme = (ROOT / "README.md").read_text("utf-8").lower()
    assert "snakemake" in readme and "workflow" in readme


def test_the_configuration_of_the_workflow_names_folders_and_settings_that_exist():
    text = (ROOT / "config/README.md").read_text("utf-8")
    assert {*re.findall(r"`(conf/\w+)`", text)} == {
        f"conf/{group}" for group in ("study", "subject", "variant", "preset", "exaggerate")
    }
    assert all((ROOT / folder).is_dir() for folder in re.findall(r"`(conf/\w+)`", text))
    lines = [words for block in read_blocks(ROOT / "config/README.md") for words in command_lines(block.script)]
    assert [words[0] for words in lines] == ["snakemake"] * 3
    for words in lines:
        for word in words:
            if word.startswith(("hydra=", "sweep=")):
                assert unknown_keys(split_overrides(word.partition("=")[2])) == []


@pytest.mark.parametrize("file", ["CODE_OF_CONDUCT.md", "config/README.md", "CHANGELOG.md"])
def test_links_of_other_documents_lead_to_files(file):
    links = re.findall(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", (ROOT / file).read_text("utf-8"))
    assert [link for link in links if not (ROOT / file).parent.joinpath(link).exists()] == []
