"""Reader of YAML files of settings: what Hydra and OmegaConf parse is checked first.

Their parser follows aliases to an exponential size, recurses as deeply as the file is nested, and takes any content.
Settings need mappings, sequences and scalars only, so files with anything else are refused.
"""

from __future__ import annotations

from pathlib import Path

import yaml

from carigs.errors import InputError
from carigs.readers.limits import read_bytes, regular_file_size
from carigs.readers.text import decode_text

MAX_YAML_BYTES = 256 << 10
MAX_YAML_NODES = 10_000
MAX_YAML_DEPTH = 16
_Loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def read_yaml_text(file: str | Path) -> str:
    """Read a YAML file and check it.

    Args:
        file: The file, in UTF-8.

    Returns:
        Its text: one mapping, or nothing, without aliases, tags, or two keys of one name.

    Raises:
        InputError: If the file is missing, exceeds a limit, is not YAML (with line and column), or holds anything else.
    """
    regular_file_size(file, "settings file")
    text = decode_text(read_bytes(file, MAX_YAML_BYTES, "settings file"), file)
    try:
        _check_events(text, file)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1} column {mark.column + 1}" if mark else None
        problem = getattr(error, "problem", None) or str(error)
        raise InputError(f"broken YAML: {' '.join(problem.split())[:200]}", file=file, field=where) from error
    return text


def _check_events(text: str, file: str | Path) -> None:
    """Refuse what settings do not need. The parser's events, unlike its nodes, need neither recursion nor memory."""
    documents = nodes = 0
    # For each mapping that is open its keys and whether a key comes next, for each sequence None.
    open_nodes: list[list | None] = []
    for event in yaml.parse(text, Loader=_Loader):
        where = f"line {event.start_mark.line + 1}"
        documents += isinstance(event, yaml.DocumentStartEvent)
        nodes += isinstance(event, yaml.NodeEvent)
        if documents > 1 or nodes > MAX_YAML_NODES:
            problem = "a second document" if documents > 1 else f"more than {MAX_YAML_NODES} values"
            raise InputError(problem, file=file, field=where)
        if isinstance(event, yaml.AliasEvent) or getattr(event, "tag", None):
            kind = "an alias (*name)" if isinstance(event, yaml.AliasEvent) else f"a tag ({event.tag[:60]})"
            raise InputError(f"{kind}; settings are plain values", file=file, field=where)
        if isinstance(event, yaml.CollectionEndEvent):
            open_nodes.pop()
        elif isinstance(event, yaml.NodeEvent):
            is_mapping, is_scalar = isinstance(event, yaml.MappingStartEvent), isinstance(event, yaml.ScalarEvent)
            if not open_nodes and not is_mapping and not (is_scalar and event.value == ""):
                raise InputError("expected keys and values", file=file, field=where)
            if open_nodes and open_nodes[-1] is not None:
                _take(open_nodes[-1], event.value if is_scalar else None, file, where)
            if not is_scalar:
                open_nodes.append([set(), True] if is_mapping else None)
            if len(open_nodes) > MAX_YAML_DEPTH:
                raise InputError(f"nested more than {MAX_YAML_DEPTH} levels deep", file=file, field=where)


def _take(mapping: list, name: str | None, file: str | Path, where: str) -> None:
    """A key or a value of an open mapping, in turn."""
    names, is_key = mapping
    if is_key and name in (None, "<<"):  # which would merge another mapping into this one
        raise InputError("a key must be a name", file=file, field=where)
    if is_key and name in names:
        raise InputError(f"the key {name[:60]} is given twice", file=file, field=where)
    names.update([name] if is_key else [])
    mapping[1] = not is_key
