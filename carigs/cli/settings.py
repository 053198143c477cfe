"""`carigs settings`: print composed settings, or the reference of all settings."""

from __future__ import annotations

from carigs.cli.options.parser import study_parser
from carigs.config import compose, compose_study, compose_variant
from carigs.config import reference as conf_reference
from carigs.config.frozen import keys_text
from carigs.settings import STAGES, reference

EXAMPLES = """examples:
  carigs settings study=paper                      the settings of a study
  carigs settings gamma=0.2 --section train        one section
  carigs settings study=ict --variant surfhead     with what a variant changes
  carigs settings study=paper --subject nersemble_104   of another subject than the study's first
  carigs settings --reference                      every key with default, range, unit and meaning
"""


def main(arguments: list[str]) -> int:
    """Run the subcommand.

    Args:
        arguments: Its command line.

    Returns:
        Exit code.
    """
    description = "Print the composed settings of a study as YAML, or the reference of all settings."
    usage = "[--subject NAME] [--variant NAME] [--section NAME] | --reference | --schema"
    parser = study_parser("settings", description, EXAMPLES, usage)
    parser.add_argument("--subject", metavar="NAME", help="as this subject has them (default: the first of the study)")
    parser.add_argument("--variant", metavar="NAME", help="as this variant has them")
    parser.add_argument("--section", choices=("study", "regions", *STAGES), help="print this section alone")
    parser.add_argument("--reference", action="store_true", help="print the reference: docs/configuration.md")
    parser.add_argument("--schema", action="store_true", help="print the JSON schema: docs/configuration.schema.json")
    parsed = parser.parse_intermixed_args(arguments)
    if parsed.reference:
        print(f"{reference.markdown()}\n{conf_reference.markdown()}", end="")
    elif parsed.schema:
        print(reference.json_schema(), end="")
    else:
        study = compose_study(*parsed.overrides).study
        subject = parsed.subject or study.subjects[0]
        choice = [*parsed.overrides, f"subject={subject}", f"seed={study.seeds[0]}"]
        settings = compose_variant(parsed.variant, *choice) if parsed.variant else compose(*choice)
        variant = f"variant {parsed.variant}" if parsed.variant else "before the changes of variants"
        print(f"# subject {subject}, {variant}, seed {study.seeds[0]}")
        print(keys_text(settings, parsed.section), end="")
    return 0
