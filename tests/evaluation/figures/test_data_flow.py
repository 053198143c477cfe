"""The drawing of the stages: its links, and that nothing lies over anything else."""

import re
from itertools import combinations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from carigs.errors import InputError
from evaluation.figures.data_flow import BOXES, HEIGHT, WIDTH, drawing, read_links, without_detours


def paths(links):
    """All pairs of a node and one that links lead to."""
    found = set(links)
    while more := {(a, d) for a, b in found for c, d in found if b == c} - found:
        found |= more
    return found


@given(st.sets(st.tuples(st.integers(0, 6), st.integers(0, 6)).filter(lambda link: link[0] < link[1])))
def test_links_that_are_kept_have_the_same_paths_and_none_can_be_left_out(links):
    kept = without_detours(links)
    assert kept <= links and paths(kept) == paths(links)
    assert all(link not in paths(kept - {link}) for link in kept)


def test_a_graph_of_rules_is_read_without_the_rules_that_are_no_stages():
    graph = """digraph { 0[label = "capture", color = "0.1"]; 1[label = "hair"]; 2[label = "settings"];
    0 -> 1
    2 -> 1 }"""
    assert read_links(graph) == {("capture", "hair")}
    with pytest.raises(InputError, match="no place for shave"):
        read_links(graph.replace("hair", "shave"))
    with pytest.raises(InputError, match="no stages"):
        read_links("")


def test_boxes_are_inside_the_picture_and_apart():
    svg = drawing({("capture", "hair"), ("card", "report")})
    width, height = map(int, re.search(r'viewBox="0 0 (\d+) (\d+)"', svg).groups())
    corners = [tuple(map(int, corner)) for corner in re.findall(r'<rect x="(\d+)" y="(\d+)"', svg)]
    assert len(corners) == len(BOXES)
    assert all(x + WIDTH < width and y + HEIGHT < height for x, y in corners)
    assert all(abs(x - u) > WIDTH or abs(y - v) > HEIGHT for (x, y), (u, v) in combinations(corners, 2))


def test_arrows_start_and_end_at_the_edges_of_their_boxes():
    """Down from a box to one below it, and from side to side in a row."""
    (down,) = re.findall(r'<path d="(M[^"]*C[^"]*)"', drawing({("capture", "exaggerate")}))
    (along,) = re.findall(r'<path d="(M[^"]*L[^"]*)"', drawing({("card", "report")}).split("</defs>")[1])
    corner = dict(re.findall(r'<rect (x="\d+" y="\d+").*\n<text[^>]*>(\w+)<', drawing(set())))
    place = {name: tuple(map(int, re.findall(r"\d+", text))) for text, name in corner.items()}
    numbers = [float(n) for n in re.findall(r"\d+", down)]
    assert numbers[1] == place["capture"][1] + HEIGHT and numbers[-1] == place["exaggerate"][1]
    assert place["exaggerate"][0] < numbers[-2] < place["exaggerate"][0] + WIDTH
    assert [float(n) for n in re.findall(r"\d+", along)][::2] == [place["card"][0], place["report"][0] + WIDTH]
