"""Dependencies: pinned with hashes, listed in the bill of materials, under licences that allow what carigs allows."""

from __future__ import annotations

import json
import re
from importlib.metadata import Distribution, PackageNotFoundError, distribution, version
from pathlib import Path

import pytest
from packaging.markers import Marker

ROOT = Path(__file__).parents[1]

PERMISSIVE = {
    "0BSD", "Apache-2.0", "Apache-2.0 WITH LLVM-exception", "BSD-2-Clause", "BSD-3-Clause", "CC0-1.0", "CNRI-Python",
    "HPND", "ISC", "MIT", "MIT-CMU", "PSF-2.0", "Zlib",
}  # fmt: skip
ALLOWED = PERMISSIVE | {"MPL-2.0", "LicenseRef-NVIDIA-Proprietary"}
"""MPL-2.0 asks for the source of its own files alone. NVIDIA's libraries are what the Linux builds of torch load; their
licence allows use and redistribution with an application."""

TEXTS = {
    "3-clause bsd license": "BSD-3-Clause",
    "apache 2.0": "Apache-2.0",
    "apache 2.0 license": "Apache-2.0",
    "apache license": "Apache-2.0",
    "apache license, version 2.0": "Apache-2.0",
    "apache software license": "Apache-2.0",
    "bsd": "BSD-3-Clause",
    "bsd 2-clause license": "BSD-2-Clause",
    "bsd 3-clause license": "BSD-3-Clause",
    "bsd license": "BSD-3-Clause",
    "gnu general public license": "GPL-3.0-or-later",
    "gnu general public license v3 or later (gplv3+)": "GPL-3.0-or-later",
    "isc license": "ISC",
    "mit license": "MIT",
    "the mit license (mit)": "MIT",
    "mozilla public license 2.0 (mpl 2.0)": "MPL-2.0",
    "python software foundation license": "PSF-2.0",
}
"""SPDX identifiers of what metadata say instead."""

READ_BY_HAND = {
    "conda-inject": "MIT",  # LICENSE in its repository
    "cuda-toolkit": "LicenseRef-NVIDIA-Proprietary",  # requirements alone; it holds no files
    "docutils": "BSD-2-Clause AND PSF-2.0 AND CC0-1.0",  # COPYING.rst; the GPL is of an Emacs mode
    "gsplat": "Apache-2.0",
    "matplotlib": "PSF-2.0",
    "nvidia-cusparselt-cu13": "LicenseRef-NVIDIA-Proprietary",
    "nvidia-nvtx": "Apache-2.0",
    "packaging": "Apache-2.0",  # or BSD-2-Clause
    "snakemake-interface-common": "MIT",
    "snakemake-interface-logger-plugins": "MIT",
    "snakemake-interface-report-plugins": "MIT",
    "snakemake-interface-scheduler-plugins": "MIT",
    "snakemake-interface-storage-plugins": "MIT",
}
"""Packages whose metadata name no licence, several in one field, or another one than their licence file."""

EXCEPTIONS: dict[str, str] = {}
"""Packages with a licence outside of `ALLOWED`, and why they are used all the same."""


def locked() -> dict[str, tuple[str, bool]]:
    """Version of each locked package, and whether this machine installs it."""
    packages: dict[str, tuple[str, bool]] = {}
    for line in (ROOT / "requirements.lock").read_text().splitlines():
        if match := re.match(r"([\w.-]+)==(\S+)(?: ; ([^\\]+))?", line):
            name, version, marker = match.groups()
            wanted = marker is None or Marker(marker).evaluate()
            if wanted or name not in packages:
                packages[name] = version, wanted
    return packages


LOCKED = locked()


def licence(package: Distribution) -> str:
    """SPDX expression of an installed package, or what its metadata say if that is not known."""
    data = package.metadata
    if expression := data.get("License-Expression"):
        return expression
    first_line = (data.get("License") or "").strip().split("\n")[0].removeprefix("Copyright").strip()
    classifiers = [text.split(" :: ")[-1] for text in data.get_all("Classifier", []) if text.startswith("License ::")]
    for text in (first_line, *classifiers):
        if identifier := TEXTS.get(text.lower()):
            return identifier
    return first_line or ", ".join(classifiers) or "unknown"


def identifiers(expression: str) -> set[str]:
    """The licences that an SPDX expression asks to keep; of alternatives all, which is stricter than necessary."""
    return {part.strip("() ") for part in re.split(r"\b(?:AND|OR)\b", expression)}


def test_every_package_of_the_lock_has_hashes():
    entries = re.split(r"\n(?=[\w.-]+==)", (ROOT / "requirements.lock").read_text())
    assert len(entries) >= len(LOCKED) > 100
    assert [entry.split()[0] for entry in entries if "--hash=sha256:" not in entry] == []


@pytest.mark.parametrize("name", sorted(LOCKED))
def test_the_licence_is_allowed(name):
    try:
        package = distribution(name)
    except PackageNotFoundError:
        if LOCKED[name][1] and not (
            name.startswith(("cuda-", "nvidia-", "triton")) and version("torch").endswith("+cpu")
        ):
            raise
        pytest.skip("not for this machine")
    found = READ_BY_HAND.get(name) or licence(package)
    if name in EXCEPTIONS:
        assert not identifiers(found) <= ALLOWED, "no exception is needed"
    else:
        assert identifiers(found) <= ALLOWED, f"{name}: {found}"


@pytest.mark.parametrize("table", [READ_BY_HAND, EXCEPTIONS])
def test_tables_name_locked_packages_alone(table):
    assert set(table) <= set(LOCKED)


@pytest.mark.parametrize(
    ("metadata", "found"),
    [
        ("License-Expression: MIT AND GPL-3.0-only", "MIT AND GPL-3.0-only"),
        ("License: GNU GENERAL PUBLIC LICENSE", "GPL-3.0-or-later"),
        (
            "Classifier: License :: OSI Approved :: GNU Affero General Public License v3",
            "GNU Affero General Public License v3",
        ),
        ("License: my own terms", "my own terms"),
        ("Summary: nothing said", "unknown"),
    ],
)
def test_other_licences_are_noticed(tmp_path, metadata, found):
    (tmp_path / "METADATA").write_text(f"Metadata-Version: 2.4\nName: x\nVersion: 1\n{metadata}\n")
    text = licence(Distribution.at(tmp_path))
    assert text == found
    assert not identifiers(text) <= ALLOWED


def test_the_bill_of_materials_lists_what_is_locked():
    """`make lock` writes both; it lists what Linux installs, so packages for other platforms are missing."""
    bill = json.loads((ROOT / "sbom.cdx.json").read_text())
    assert bill["bomFormat"] == "CycloneDX"
    assert bill["metadata"]["component"]["name"] == "carigs"
    listed = {re.sub(r"[-_.]+", "-", part["name"]).lower(): part["version"] for part in bill["components"]}
    assert {name: listed.get(name) for name, (_, wanted) in LOCKED.items() if wanted} == {
        name: version for name, (version, wanted) in LOCKED.items() if wanted
    }


def test_the_bill_of_materials_names_no_place_on_a_machine():
    text = (ROOT / "sbom.cdx.json").read_text()
    assert re.findall(r'"(?:file:|/)[^"]*"', text) == []
