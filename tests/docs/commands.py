"""Command lines of carigs, parsed and not run."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest
from docs.blocks import ROOT

from carigs.cli.main import COMMANDS
from carigs.config import GROUPS


class Parsed(Exception):
    """A command line is right; holds what it says."""


def parse(words: list[str], monkeypatch: pytest.MonkeyPatch) -> argparse.Namespace:
    """Parse a command line of carigs by its own parser, and do nothing else.

    Raises:
        SystemExit: If the parser refuses it.
    """

    def stop(method):
        def parse_and_stop(self, arguments):
            raise Parsed(method(self, arguments))

        return parse_and_stop

    name, *arguments = words
    assert name in COMMANDS, f"carigs {name} does not exist"
    module = "conversion.captures" if name == "convert" and not Path(arguments[0]).suffix else name
    with monkeypatch.context() as patched:
        for method in ("parse_args", "parse_intermixed_args"):
            patched.setattr(argparse.ArgumentParser, method, stop(getattr(argparse.ArgumentParser, method)))
        with pytest.raises(Parsed) as parsed:
            import_module(f"carigs.cli.{module}").main(arguments)
    return parsed.value.args[0]


@cache
def known_keys() -> frozenset[str]:
    """The keys of the settings reference, and the groups of `conf`."""

    def keys(schema: dict, at: str) -> set[str]:
        below = schema.get("properties", {})
        return {at}.union(*(keys(inner, f"{at}.{name}".lstrip(".")) for name, inner in below.items()))

    return frozenset(keys(json.loads((ROOT / "docs/configuration.schema.json").read_text()), "")) | {*GROUPS}


def unknown_keys(overrides: Sequence[str]) -> list[str]:
    """The overrides whose key is neither a setting nor a group."""
    return [override for override in overrides if override.partition("=")[0] not in known_keys()]
