"""Hooks of MkDocs: generated pages, and links that lead out of docs/.

- One page of the API reference per package of `carigs` and `evaluation`; mkdocstrings fills it from the docstrings.
- CONTRIBUTING.md and CHANGELOG.md become pages. `<!-- site: section "TITLE" of FILE -->` inserts a section of a file.
- A link to a file outside docs/ becomes a link to its page or its entry in the API reference; else to the repository,
  if pyproject.toml states its address; else it is shown as plain text with the path.
- A dotted name such as `carigs.mesh.curvature` becomes a link to the API reference.
- Inline code such as `carigs/mesh/curvature.py:gaussian_curvature` becomes one, too, with the name alone.
- A link whose text is the name of a page's file gets the title of the page.

The sources stay plain Markdown, in which links lead to files.
"""

from __future__ import annotations

import ast
import posixpath
import re
import tomllib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("carigs", "evaluation")
API = "api/index.md"
INCLUDED = {"contributing.md": "CONTRIBUTING.md", "changelog.md": "CHANGELOG.md"}
"""Pages that are copies of files at the root of the repository."""
PAGES = {file: page for page, file in INCLUDED.items()} | {"README.md": "index.md", "carigs": API, "evaluation": API}
"""Page of a file outside docs/."""
SEARCH_BOOST = {"notebook/": 0.2, "api/": 0.5}
"""Factors on the ranks of pages in the search."""

FENCE = re.compile(r"^( *)(```+|~~~+).*?^\1\2[ \t]*$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"(?<!!)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")
CONTINUED = re.compile(r"^   (?=\S)", re.MULTILINE)
NEXT_ITEM = re.compile(r"^(    \S.*\n)(?=\d+\. )", re.MULTILINE)
NAME = re.compile(r'(?<!">)<code>((?:carigs|evaluation)(?:\.\w+)+)</code>(?!</a>)')
CODE = re.compile(r"(?<![`\[])`((?:carigs|evaluation)/[\w/]*?)(?:(\.py)(?::([A-Za-z_][\w.]*))?|/)`(?!`|\])")
SECTION = re.compile(r'<!-- site: section "([^"]+)" of (\S+) -->')


def on_config(config: Any) -> Any:
    """Add the generated pages to the navigation.

    Args:
        config: Configuration of MkDocs.

    Returns:
        The configuration.
    """
    config.nav = _filled(config.nav)
    return config


def on_files(files: Any, config: Any) -> Any:
    """Add the generated pages to the files of the site.

    Args:
        files: Files that MkDocs found in docs/.
        config: Configuration of MkDocs.

    Returns:
        The files.
    """
    from mkdocs.structure.files import File

    pages = {API: _api_index()} | {f"api/{package}.md": _api_page(package) for package in packages()}
    pages |= {page: (ROOT / file).read_text("utf-8") for page, file in INCLUDED.items() if (ROOT / file).exists()}
    for page, text in pages.items():
        files.append(File.generated(config, page, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Insert sections of other files, and rewrite links.

    Args:
        markdown: Text of a page.
        page: The page.
        config: Configuration of MkDocs.
        files: Files of the site.

    Returns:
        The text for MkDocs.
    """
    uri = page.file.src_uri
    for folder, boost in SEARCH_BOOST.items():
        if uri.startswith(folder):
            page.meta.setdefault("search", {"boost": boost})
    if uri.startswith("api/"):
        return markdown
    source = INCLUDED.get(uri, f"docs/{uri}")
    text = rewrite(markdown, source, uri)

    def insert(match: re.Match[str]) -> str:
        file = posixpath.normpath(posixpath.join(posixpath.dirname(source), match[2]))
        return rewrite(section(file, match[1]), file, uri)

    return SECTION.sub(insert, text)


def on_page_content(html: str, page: Any, config: Any, files: Any) -> str:
    """Turn dotted names, such as `carigs.mesh.curvature`, into links to the API reference.

    Args:
        html: Content of a page.
        page: The page.
        config: Configuration of MkDocs.
        files: Files of the site.

    Returns:
        The content. Names without an entry in the reference stay as they are.
    """
    return NAME.sub(r'<autoref identifier="\1" optional><code>\1</code></autoref>', html)


def rewrite(markdown: str, source: str, page: str) -> str:
    """Rewrite the links of a text for the site.

    Args:
        markdown: The text.
        source: File of the repository that it comes from.
        page: Page of the site that it is shown on.

    Returns:
        The text with links that work in the site, and numbered items indented and separated as Python-Markdown needs
        it. Fenced code is not changed.
    """

    def link(match: re.Match[str]) -> str:
        text, target = match.groups()
        path, _, anchor = target.partition("#")
        if not path or re.match(r"[a-z]+:", path):
            return match[0]
        file = posixpath.normpath(posixpath.join(posixpath.dirname(source), path))
        if file.startswith("docs/"):
            to = file.removeprefix("docs/")
        elif file in PAGES and (ROOT / file).exists():
            to = PAGES[file]
        elif name := api_name(file):
            return f"[{text}][{name}]"
        else:
            return _outside(text, file)
        if text == posixpath.basename(path) or text == file:
            text = title(file)
        to = posixpath.relpath(to, posixpath.dirname(page) or ".")
        return f"[{text}]({to}{'#' + anchor if anchor else ''})"

    def code(match: re.Match[str]) -> str:
        name = api_name(match[1] + (match[2] or ""), match[3])
        shown = f"`{match[3]}`" if match[3] else match[0]
        return f"[{shown}][{name}]" if name else match[0]

    def lists(text: str) -> str:
        return NEXT_ITEM.sub("\\1\n", CONTINUED.sub(" " * 4, text))

    return _outside_fences(markdown, lambda text: CODE.sub(code, LINK.sub(link, lists(text))))


@cache
def title(file: str) -> str:
    """Title of a Markdown file.

    Args:
        file: Path in the repository.

    Returns:
        Its first heading, or the name of the file if it has none.
    """
    path = ROOT / file
    text = path.read_text("utf-8") if path.suffix == ".md" and path.is_file() else ""
    found = re.search(r"^# (.+)$", text, re.MULTILINE)
    return found[1] if found else path.name


def section(file: str, heading: str) -> str:
    """Take a section out of a Markdown file.

    Args:
        file: Path in the repository.
        heading: Heading of the section.

    Returns:
        Its text without the heading.

    Raises:
        ValueError: If there is no such section.
    """
    lines = (ROOT / file).read_text("utf-8").splitlines()
    starts = [i for i, line in enumerate(lines) if re.fullmatch(rf"#+ {re.escape(heading)}", line)]
    if not starts:
        raise ValueError(f"{file} has no section {heading!r}")
    level = len(lines[starts[0]].split(" ")[0])
    end = next((i for i in range(starts[0] + 1, len(lines)) if re.match(rf"#{{1,{level}}} ", lines[i])), len(lines))
    return "\n".join(lines[starts[0] + 1 : end]).strip()


@cache
def packages() -> tuple[str, ...]:
    """List the packages of the repository.

    Returns:
        Dotted names of all folders with Python modules.
    """
    found = {file.parent.relative_to(ROOT) for top in PACKAGES for file in (ROOT / top).rglob("__init__.py")}
    return tuple(sorted(".".join(folder.parts) for folder in found))


def modules(package: str) -> list[str]:
    """List the modules of a package.

    Args:
        package: Dotted name.

    Returns:
        Dotted names of its public modules, without those of packages inside it.
    """
    files = sorted(ROOT.joinpath(*package.split(".")).glob("*.py"))
    return [f"{package}.{file.stem}" for file in files if not file.stem.startswith("_")]


def api_name(path: str, name: str | None = None) -> str | None:
    """Name of an entry of the API reference.

    Args:
        path: A module or package in the repository, such as `carigs/mesh/curvature.py`.
        name: What it defines, such as `gaussian_curvature` or `CotanLaplacian.divergence_matrix`.

    Returns:
        The dotted name; that of the class or module where the reference has no entry for the name, and None where it
        has no such module.
    """
    path = path.rstrip("/")
    dotted = path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    if dotted in packages():
        return dotted
    if not path.endswith(".py") or not (ROOT / path).is_file() or dotted.rpartition(".")[2].startswith("_"):
        return None
    parts = name.split(".") if name else []
    while parts and ".".join(parts) not in _documented(path):
        parts.pop()
    return ".".join([dotted, *parts])


@cache
def _documented(path: str) -> frozenset[str]:
    """Public names of a module that have a docstring, as `Class.method`."""
    found = set()

    def collect(body: list[ast.stmt], prefix: str) -> None:
        for node, following in zip(body, [*body[1:], None], strict=True):
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and ast.get_docstring(node):
                names = [node.name]
            elif isinstance(node, ast.Assign | ast.AnnAssign) and _is_text(following):
                targets = [node.target] if isinstance(node, ast.AnnAssign) else node.targets
                names = [n.id for target in targets for n in ast.walk(target) if isinstance(n, ast.Name)]
            else:
                continue
            found.update(f"{prefix}{name}" for name in names if not name.startswith("_"))
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                collect(node.body, f"{prefix}{node.name}.")

    collect(ast.parse((ROOT / path).read_text("utf-8")).body, "")
    return frozenset(found)


def _is_text(node: ast.stmt | None) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _outside(text: str, file: str) -> str:
    """A link to a file that is not in the site."""
    if address := _repository():
        return f"[{text}]({address}/blob/main/{file})"
    plain = text.strip("`")
    return f"`{file}`" if plain == file or file.endswith(f"/{plain}") else f"{text} (`{file}`)"


@cache
def _repository() -> str | None:
    """Address of the repository on GitHub, if pyproject.toml states it."""
    urls = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"].get("urls", {})
    found = (re.match(r"https://github\.com/[\w.-]+/[\w.-]+", url) for url in urls.values())
    return next((match[0].removesuffix(".git") for match in found if match), None)


def _outside_fences(text: str, change: Callable[[str], str]) -> str:
    parts, end = [], 0
    for fence in FENCE.finditer(text):
        parts += [change(text[end : fence.start()]), fence[0]]
        end = fence.end()
    return "".join([*parts, change(text[end:])])


def _filled(nav: list[Any]) -> list[Any]:
    """The navigation with the packages below the API reference, and without pages whose file does not exist."""
    filled = []
    for entry in nav:
        ((title, value),) = entry.items() if isinstance(entry, dict) else ((None, entry),)
        if isinstance(value, list):
            filled.append({title: _filled(value)})
        elif value == API:
            tops = [{top: [_entry(name) for name in packages() if name.split(".")[0] == top]} for top in PACKAGES]
            filled.append({title: [API, *tops]})
        elif value not in INCLUDED or (ROOT / INCLUDED[value]).exists():
            filled.append(entry)
    return filled


def _entry(package: str) -> dict[str, str]:
    return {package: f"api/{package}.md"}


def _summary(package: str) -> str:
    """First paragraph of the docstring of a package, for a cell of a table."""
    text = ast.get_docstring(ast.parse((ROOT.joinpath(*package.split(".")) / "__init__.py").read_text("utf-8"))) or ""
    return " ".join(text.partition("\n\n")[0].split()).replace("|", "\\|")


def _api_index() -> str:
    lines = [
        "# API reference",
        "",
        "All packages, with the first sentence of each. [Contributing](../contributing.md#how-the-code-is-laid-out)",
        "lists them from the lowest to the highest. [Library](../library.md) shows the functions for scripts.",
    ]
    for top in PACKAGES:
        lines += ["", f"## `{top}`", "", "| package | what it holds |", "|---|---|"]
        named = [package for package in packages() if package.split(".")[0] == top]
        lines += [f"| [`{package}`]({package}.md) | {_summary(package)} |" for package in named]
    return "\n".join([*lines, ""])


def _api_page(package: str) -> str:
    """A page of mkdocstrings: the package, then each of its modules."""
    head = f"::: {package}\n    options:\n      heading_level: 1\n      members: false\n"
    each = (f"::: {module}\n    options:\n      heading_level: 2\n" for module in modules(package))
    return "\n".join(["---", f"title: {package}", "---", "", head, *each])
