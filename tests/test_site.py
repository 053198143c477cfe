"""The documentation site: navigation, links, no other host, width, and where the facts of the paper are found."""

from __future__ import annotations

import importlib.util
import json
import os
import re
import subprocess
import time
from functools import cached_property
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
import yaml

from evaluation.screenshots.chromium import CHROMIUM, Browser

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
MKDOCS = ROOT / ".venv/docs/bin/mkdocs"
MAX_MEGABYTES = 40
PAGES = ("index.html", "api/carigs.mesh.html", "benchmarks.html", "paper.html", "results/index.html")
WIDTHS = (390, 1400)
LOADED = {
    ("script", "src"), ("link", "href"), ("img", "src"), ("img", "srcset"), ("source", "src"), ("source", "srcset"),
    ("iframe", "src"), ("video", "src"), ("video", "poster"), ("audio", "src"), ("embed", "src"), ("object", "data"),
}  # fmt: skip
"""Attributes whose address a browser loads without being asked."""

FACTS = {
    "equation 1": "Equation 1,",
    "equation 2": "Equation 2,",
    "abs(K)_eps": "Appendix, `abs(K)_eps",
    "equation 3": "Equation 3,",
    "equation 4": "Equation 4,",
    "equation 5": "Equation 5,",
    "equation 6": "Equation 6,",
    "equation 7": "Equation 7,",
    "equation 8": "Equation 8,",
    "equation 9": "Equation 9 ",
    "hair mask": "Hair boundary",
    "visibility mask": "Visibility:",
    "ear mask": "Eyelids and ear tips",
    "freezing": "Freezing of Gaussians",
    "alternation": "Random alternation",
    "CLIP-D": "CLIP-D",
}
"""Words that a reader of the paper looks for, and how the row of the map of the paper begins."""

OTHER_PROGRAMS = (
    "KEY: Key 'NAME' not in 'SECTION'; known: ...", "Directory cannot be locked", "FILE: No space left on device",
)  # fmt: skip
"""Messages of OmegaConf, Snakemake and the operating system."""


def site_hooks():
    """The hooks of MkDocs as a module."""
    spec = importlib.util.spec_from_file_location("site_hooks", DOCS / "site_hooks.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


HOOKS = site_hooks()


def nav_pages(entries: list) -> list[str]:
    """The pages of a navigation."""
    pages = []
    for entry in entries:
        value = next(iter(entry.values())) if isinstance(entry, dict) else entry
        pages += nav_pages(value) if isinstance(value, list) else [value]
    return pages


def test_the_navigation_has_every_page_once():
    pages = nav_pages(yaml.safe_load((ROOT / "mkdocs.yml").read_text("utf-8"))["nav"])
    written = [page for page in pages if page not in {HOOKS.API, *HOOKS.INCLUDED}]
    assert sorted(written) == sorted(file.relative_to(DOCS).as_posix() for file in DOCS.rglob("*.md"))


def test_links_lead_to_pages_and_to_the_reference():
    def shown(text: str) -> str:
        return HOOKS.rewrite(text, "docs/method/page.md", "method/page.md")

    function = "carigs.mesh.curvature.gaussian_curvature"
    assert shown("[a](../paper.md#masks)") == "[a](../paper.md#masks)"
    assert shown("[paper.md](../paper.md)") == "[Map of the paper](../paper.md)"
    assert shown("[b](../../CONTRIBUTING.md#rules)") == "[b](../contributing.md#rules)"
    assert shown("[c](../../carigs)") == "[c](../api/index.md)"
    assert shown("[d](../../carigs/mesh/curvature.py)") == "[d][carigs.mesh.curvature]"
    code = "`carigs/mesh/curvature.py:gaussian_curvature`"
    assert shown(code) == f"[`gaussian_curvature`][{function}]"
    assert shown(f"```\n{code}\n```") == f"```\n{code}\n```"
    assert shown("`carigs/mesh/no_such_module.py`") == "`carigs/mesh/no_such_module.py`"


def test_a_link_to_another_file_is_its_path_or_leads_to_the_repository(monkeypatch):
    link = "[profile](../profiles/default/config.yaml)"
    monkeypatch.setattr(HOOKS, "_repository", lambda: None)
    assert HOOKS.rewrite(link, "docs/a.md", "a.md") == "profile (`profiles/default/config.yaml`)"
    monkeypatch.setattr(HOOKS, "_repository", lambda: "https://github.com/a/b")
    address = "https://github.com/a/b/blob/main/profiles/default/config.yaml"
    assert HOOKS.rewrite(link, "docs/a.md", "a.md") == f"[profile]({address})"


def test_a_numbered_item_is_indented_by_four_and_ends_before_a_blank_line():
    text = "1. a\n\n   | b |\n   |---|\n2. c\n"
    assert HOOKS.rewrite(text, "docs/a.md", "a.md") == "1. a\n\n    | b |\n    |---|\n\n2. c\n"


def test_a_section_ends_with_the_next_heading_and_must_exist():
    rooms = HOOKS.section("CONTRIBUTING.md", "How the code is laid out")
    assert "`carigs/mesh/`" in rooms and "\n## " not in rooms
    with pytest.raises(ValueError, match="no section"):
        HOOKS.section("CONTRIBUTING.md", "No such heading")


@pytest.mark.parametrize("row", FACTS.values(), ids=FACTS.keys())
def test_the_map_of_the_paper_names_a_function_for_each_fact(row):
    (line,) = [line for line in (DOCS / "paper.md").read_text("utf-8").splitlines() if line.startswith(f"| {row}")]
    names = re.findall(r"`((?:carigs|evaluation)/[\w/]+\.py):([\w.]+)`", line)
    assert any(HOOKS.api_name(file, name).endswith(f".{name}") for file, name in names)


def messages() -> list[str]:
    """The messages of the page on troubleshooting that carigs itself prints."""
    lines = (DOCS / "troubleshooting.md").read_text("utf-8").splitlines()
    cells = [line.split(" | ")[0] for line in lines if line.startswith("| `")]
    return [message for cell in cells for message in re.findall(r"`([^`]+)`", cell) if message not in OTHER_PROGRAMS]


@pytest.fixture(scope="module")
def sources():
    """All code, with texts that are continued on the next line in one piece."""
    text = "\n".join(file.read_text("utf-8") for top in HOOKS.PACKAGES for file in sorted((ROOT / top).rglob("*.py")))
    return re.sub(r'"\s*\n\s*f?"', "", text)


@pytest.mark.parametrize("message", messages())
def test_a_message_of_the_troubleshooting_page_is_in_the_code(message, sources):
    words = max(re.split(r"\.\.\.|\b[A-Z]+s?\b", message), key=len).strip(" =:;,()").split()
    length = min(3, len(words))
    runs = [" ".join(words[i : i + length]) for i in range(len(words) - length + 1)]
    assert any(run in sources for run in runs)


class Page(HTMLParser):
    """What a page links to, loads, and can be linked to."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.anchors, self.links, self.loaded = set(), [], []
        self.feed(file.read_text("utf-8"))

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        values = dict(attributes)
        self.anchors |= {values[key] for key in ("id", "name") if values.get(key)}
        if tag == "a" and values.get("href"):
            self.links.append(values["href"])
        self.loaded += [value for key, value in attributes if (tag, key) in LOADED and value]


class Site:
    """The built site."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @cached_property
    def pages(self) -> dict[str, Page]:
        """All pages but that of errors, whose links suit a server alone."""
        files = sorted(self.folder.rglob("*.html"))
        return {f.relative_to(self.folder).as_posix(): Page(f) for f in files if f.name != "404.html"}

    @cached_property
    def search(self) -> list[dict]:
        """Entries of the search index."""
        return json.loads((self.folder / "search/search_index.json").read_text("utf-8"))["docs"]

    def resolve(self, page: str, link: str) -> tuple[str, str]:
        """File and anchor of a relative link."""
        parts = urlsplit(link)
        path = os.path.normpath((Path(page).parent / unquote(parts.path)).as_posix()) if parts.path else page
        return path, unquote(parts.fragment)


@pytest.fixture(scope="session")
def site(tmp_path_factory):
    if not MKDOCS.exists():
        pytest.skip("no .venv/docs; `make docs` makes it")
    folder = tmp_path_factory.mktemp("site") / "site"
    command = [MKDOCS, "build", "--strict", "--quiet", "--site-dir", folder]
    environment = os.environ | {"NO_MKDOCS_2_WARNING": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "WARNING" not in done.stdout + done.stderr
    return Site(folder)


@pytest.mark.docs
@pytest.mark.slow
def test_every_internal_link_and_anchor_leads_somewhere(site):
    broken = []
    for name, page in site.pages.items():
        for link in page.links:
            if urlsplit(link).scheme:
                continue
            file, anchor = site.resolve(name, link)
            if not (site.folder / file).is_file() or (
                anchor and file in site.pages and anchor not in site.pages[file].anchors
            ):
                broken.append(f"{name}: {link}")
    assert broken == []


@pytest.mark.docs
@pytest.mark.slow
def test_nothing_is_loaded_from_another_host(site):
    loaded = {f"{name}: {address}" for name, page in site.pages.items() for address in page.loaded}
    assert not [entry for entry in loaded if re.search(r": (https?:)?//", entry)]
    missing = []
    for name, page in site.pages.items():
        for address in page.loaded:
            if not address.startswith("data:") and not (site.folder / site.resolve(name, address)[0]).is_file():
                missing.append(f"{name}: {address}")
    assert missing == []
    styles = [file.read_text("utf-8") for file in site.folder.rglob("*.css")]
    assert styles and not [s for s in styles if re.search(r"(url\(|@import)\s*['\"]?(https?:)?//", s)]


@pytest.mark.docs
@pytest.mark.slow
def test_the_site_is_small(site):
    assert sum(file.stat().st_size for file in site.folder.rglob("*") if file.is_file()) < MAX_MEGABYTES * 1e6


@pytest.mark.docs
@pytest.mark.slow
def test_every_fact_of_the_paper_is_two_clicks_from_the_index(site):
    assert "paper.html" in {site.resolve("index.html", link)[0] for link in site.pages["index.html"].links}
    rows = re.findall(r"<tr>.*?</tr>", (site.folder / "paper.html").read_text("utf-8"), re.DOTALL)
    texts = [(re.sub(r"<[^>]+>|\s+", " ", row).strip(), row) for row in rows]
    for fact, beginning in FACTS.items():
        start = beginning.replace("`", " ").split()
        (row,) = [row for text, row in texts if text.split()[: len(start)] == start]
        targets = [site.resolve("paper.html", link) for link in re.findall(r'href="([^"]+)"', row)]
        assert any(file.startswith("api/") and anchor in site.pages[file].anchors for file, anchor in targets), fact


@pytest.mark.docs
@pytest.mark.slow
@pytest.mark.parametrize("fact", FACTS)
def test_the_search_index_has_every_fact_of_the_paper(site, fact):
    pattern = re.compile(rf"\b{re.escape(fact)}(?!\w)", re.IGNORECASE)
    assert [entry["location"] for entry in site.search if pattern.search(f"{entry['title']} {entry['text']}")]


@pytest.fixture(scope="session")
def browser(tmp_path_factory):
    if CHROMIUM is None:
        pytest.skip("no Chromium")
    started = Browser(tmp_path_factory.mktemp("profile"))
    yield started
    started.close()


@pytest.mark.docs
@pytest.mark.slow
@pytest.mark.browser
@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("page", PAGES)
def test_a_page_fits_its_window_and_shows_its_images(site, browser, page, width):
    browser.open((site.folder / page).as_uri(), width, 900)
    assert browser.value("document.documentElement.scrollWidth") <= browser.value("window.innerWidth")
    broken = "[...document.images].filter(image => image.complete && !image.naturalWidth).map(image => image.src)"
    assert browser.value(broken) == []
    assert browser.schemes() <= {"file", "data", "blob"}
    assert browser.problems() == []


@pytest.mark.docs
@pytest.mark.slow
@pytest.mark.browser
def test_the_search_works_without_a_server(site, browser):
    browser.open((site.folder / "index.html").as_uri(), 1400, 900)
    browser.value(
        "(() => { const field = document.querySelector('input.md-search__input'); field.focus();"
        " field.value = 'visibility mask'; field.dispatchEvent(new Event('input', {bubbles: true}));"
        " field.dispatchEvent(new KeyboardEvent('keyup', {bubbles: true})); })()"
    )
    links = "[...document.querySelectorAll('a.md-search-result__link')].map(link => link.href)"
    deadline = time.monotonic() + 60
    while not (found := browser.value(links)) and time.monotonic() < deadline:
        time.sleep(0.2)
    assert any("paper.html" in link or "targets.html" in link or "gtstar" in link for link in found)
    assert browser.schemes() <= {"file", "data", "blob"}
