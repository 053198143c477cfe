"""The example of docs/kernels.md compiles, and passes the test that stands beside it."""

import importlib
import sys

import pytest
from docs.blocks import ROOT, parse_blocks

GUIDE = ROOT / "docs/kernels.md"
MODULE = "unit_vectors_of_the_guide"


def example_and_test() -> list[str]:
    return [block.text for block in parse_blocks(GUIDE, GUIDE.read_text("utf-8")) if block.language == "python"]


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    """The module of the first block, with the tests of the second one; importable, as its kernel in the cache needs."""
    folder = tmp_path_factory.mktemp("guide")
    (folder / f"{MODULE}.py").write_text("\n".join(example_and_test()), "utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        yield importlib.import_module(MODULE)
        sys.modules.pop(MODULE)


@pytest.mark.parametrize("count", [1, 15, 16, 17, 1025])
def test_the_example_gives_the_numbers_of_float64(example, count):
    example.test_unit_vectors_are_those_of_float64(count)


def test_the_example_takes_lengths_without_a_direction(example):
    example.test_lengths_without_a_direction()


def test_the_guide_has_the_example_and_its_test():
    code, test = example_and_test()
    assert "@kernel" in code
    assert test.count("def test_") == 2
