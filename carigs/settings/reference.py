"""The reference of the settings: docs/configuration.md and docs/configuration.schema.json, made from the dataclasses.

After a change of a field run

    carigs settings --reference > docs/configuration.md
    carigs settings --schema > docs/configuration.schema.json
"""

from __future__ import annotations

import ast
import inspect
import json
import textwrap
from collections.abc import Iterator
from dataclasses import fields
from itertools import pairwise
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints

from carigs.settings import Config
from carigs.settings.mask_flags import DEFAULT_MASK_FLAGS, MaskFlag
from carigs.settings.option import Option, Section, option_of, subsection

_HEADER = """# Configuration

All settings with defaults, units, allowed values and meanings, and the presets. This file is generated from the
dataclasses in `carigs/settings` and from `conf/` (`carigs settings --reference`), and so is the JSON schema
`configuration.schema.json`.

A study is composed by [Hydra](https://hydra.cc): the defaults below, changed by the files of `conf/` that a study, its
subjects and its variants name, changed by the command line:

```
carigs run study=ict train.iterations=2000 train.density.every=0
carigs settings study=ict                                          # what it comes to
```

Files of your own go into `conf/study`, `conf/subject` and `conf/variant` of the current directory. Lists replace the
default as a whole, except `train.mask_flags`, which variants change by `train.add_mask_flags` and
`train.remove_mask_flags`. Every value is checked before any work starts.

Numbers of threads are no settings, because no result depends on them: jobs of the stages `hair` and `gtstar` take two,
all others one. Snakemake's option changes that, `carigs run -- --set-threads train=4`, and so does `set-threads` of a
profile.

Where a key holds text, such as the name of a file, all that follows `=` is the value as it stands, whatever characters
it has, and so is each element of a list of texts:

```
carigs run train.start=results/toy/toy/gamma=0.25/alternating/seed=0/avatar.npz
carigs run "metrics.edit_prompt='A long nose, large ears'"
```

A comma separates the values of a sweep, `null` is no value, and `${gamma}` or `${oc.env:HOME}` stands for what another
key or a variable of the environment holds. To have them as text, write the value in quotes of its own, which the shell
must not remove, as in the second line; instead of `${` type `\\${`. Blanks, `#`, `(`, `!` and `$` mean something to the
shell, so put such a word in quotes. Snakemake changes some characters of `--config hydra="..."`: write such overrides
to a file, as in a shell, and type `hydra=@FILE`. In a file of `conf/`, text that YAML reads as a number or a boolean
needs quotes: `name: '007'`. Numbers are decimal: `010`, `0x1F` and `20:30`, which YAML reads as 8, 31 and 1230, are
refused.
"""
_TYPES = {bool: "boolean", int: "integer", float: "number", str: "string"}


def markdown() -> str:
    """The reference as Markdown.

    Returns:
        Text of docs/configuration.md.
    """
    return "\n".join([_HEADER, *_section(Config, "General"), *_mask_flags()])


def json_schema() -> str:
    """The JSON schema (draft 2020-12) of the composed settings.

    Returns:
        Text of docs/configuration.schema.json.
    """
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "carigs", **_object(Config)}
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def meanings(section: type) -> dict[str, str]:
    """The docstrings of the fields of a class.

    Args:
        section: Class of a section, or an enumeration.

    Returns:
        Text by name of the field.
    """
    body = ast.parse(textwrap.dedent(inspect.getsource(section))).body[0].body
    named = [
        (statement.target if isinstance(statement, ast.AnnAssign) else statement.targets[0], below)
        for statement, below in pairwise(body)
        if isinstance(statement, ast.AnnAssign | ast.Assign) and isinstance(below, ast.Expr)
    ]
    return {target.id: " ".join(below.value.value.split()) for target, below in named}


def _section(section: type[Section], title: str) -> Iterator[str]:
    """A heading and the table of a section, then those of its subsections."""
    texts, properties = meanings(section), _object(section)["properties"]
    yield f"## {title}\n\n{section.__doc__}\n"
    yield "| key | type | default | allowed | unit | meaning |"
    yield "|---|---|---|---|---|---|"
    below = []
    for f in fields(section):
        meta = option_of(f)
        if meta.set_by:
            continue
        if nested := subsection(f):
            below.append(nested)
            continue
        needed = ""
        if meta.required_when:
            other, values = meta.required_when
            needed = f"needed for {' or '.join(f'{other}={value}' for value in values)}"
        allowed = needed or meta.choices_name or meta.allowed().removeprefix("lie in ").removeprefix("be ")
        key, schema = f"{section.key}.{f.name}".lstrip("."), properties[f.name]
        default = json.dumps(schema["default"], ensure_ascii=False)
        cells = (f"`{key}`", _type_name(schema), f"`{default}`", allowed, meta.unit, texts[f.name])
        yield "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
    yield ""
    for nested in below:
        yield from _section(nested, f"`{nested.key}`")


def _mask_flags() -> Iterator[str]:
    """The table of the mask flags."""
    yield "## Mask flags\n\nNames for `train.mask_flags`: why a pixel of a GT* frame cannot be trusted.\n"
    yield "| flag | in the default | meaning |"
    yield "|---|---|---|"
    for name, text in meanings(MaskFlag).items():
        yield f"| `{name.lower()}` | {'yes' if name.lower() in DEFAULT_MASK_FLAGS else 'no'} | {text} |"
    yield ""


def _type_name(schema: dict[str, Any]) -> str:
    """The type of a value in words."""
    if "items" in schema:
        return f"list of {schema['items']['type']}s"
    if "additionalProperties" in schema:
        return f"map to {schema['additionalProperties']['type']}s"
    return " or ".join(schema["type"]) if isinstance(schema["type"], list) else schema["type"]


def _object(section: type[Section]) -> dict[str, Any]:
    """The schema of a section."""
    hints, texts, defaults, properties = get_type_hints(section), meanings(section), section(), {}
    for f in fields(section):
        meta, text = option_of(f), texts.get(f.name, "")
        if meta.set_by:
            continue
        if nested := subsection(f):
            properties[f.name] = _object(nested)
            continue
        text = f"{text} Unit: {meta.unit}." if meta.unit else text
        allowed = _schema_type(hints[f.name], meta)
        properties[f.name] = {"description": text, "default": getattr(defaults, f.name), **allowed}
    described = {"type": "object", "description": section.__doc__}
    return {**described, "properties": properties, "additionalProperties": False}


def _schema_type(hint: Any, meta: Option) -> dict[str, Any]:
    """Type and allowed values; those of the elements for lists and maps."""
    if isinstance(hint, UnionType):
        inner = _schema_type(next(part for part in get_args(hint) if part is not type(None)), meta)
        return {**inner, "type": [inner["type"], "null"]}
    if get_origin(hint) is tuple:
        return {"type": "array", "items": _schema_type(get_args(hint)[0], meta)}
    if get_origin(hint) is dict:
        return {"type": "object", "additionalProperties": _schema_type(get_args(hint)[1], meta)}
    bounds = {"minimum": meta.ge, "exclusiveMinimum": meta.gt, "maximum": meta.le, "exclusiveMaximum": meta.lt}
    schema: dict[str, Any] = {"type": _TYPES[hint]} | {name: b for name, b in bounds.items() if b is not None}
    if meta.pattern:
        schema["pattern"] = f"^(?:{meta.pattern})$"
    if meta.choices and not meta.choices_name:
        schema["enum"] = list(meta.choices)
    if meta.excluded is not None:
        schema["not"] = {"const": meta.excluded}
    return schema
