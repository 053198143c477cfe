"""The page of a report: nothing from outside runs or is asked for, its size is kept, and readers find their way."""

from __future__ import annotations

import base64
import re
from hashlib import sha256
from html.parser import HTMLParser
from itertools import pairwise

import cv2
import numpy as np
import pytest
from report_pages import AVATAR_PAGE, COLOURS, HOSTILE, plain, report

from carigs.errors import CarigsWarning, InputError
from evaluation.report.images import data_uri
from evaluation.report.page import ReportContent, page_within, report_page
from evaluation.report.training_chart import HEIGHT, WIDTH, moving_mean, subject_chart


class Page(HTMLParser):
    """Tags with their attributes, and the text of each script and style."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags, self.code, self.inside = [], [], None
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        self.inside = tag if tag in ("script", "style") else None

    def handle_data(self, data):
        if self.inside:
            self.code.append((self.inside, data))
            self.inside = None


def test_names_and_messages_are_text():
    safe, hostile = Page(report_page(report())), Page(report_page(report(HOSTILE)))
    assert [tag for tag, _ in hostile.tags] == [tag for tag, _ in safe.tags]
    assert [attributes.keys() for _, attributes in hostile.tags] == [attributes.keys() for _, attributes in safe.tags]
    assert hostile.code == safe.code
    assert "{{ 7 * 7 }}" in report_page(report(HOSTILE))


def test_the_policy_allows_the_script_and_the_style_of_the_page_alone():
    page = Page(report_page(report()))
    policy = next(a["content"] for tag, a in page.tags if a.get("http-equiv") == "Content-Security-Policy")
    rules = dict(rule.split(" ", 1) for rule in policy.split("; "))
    for kind, text in page.code:
        assert rules[f"{kind}-src"] == f"'sha256-{base64.b64encode(sha256(text.encode()).digest()).decode()}'"
    assert (rules["default-src"], rules["img-src"]) == ("'none'", "data:")
    assert [kind for kind, _ in page.code] == ["style", "script"]


def test_the_page_asks_for_nothing_from_outside():
    page = Page(report_page(report()))
    for tag, attributes in page.tags:
        for name, value in attributes.items():
            assert not name.startswith("on")
            assert name != "style"
            if name in ("src", "href"):
                assert value.startswith("data:" if tag == "img" else "#") or value == AVATAR_PAGE
    assert not {tag for tag, _ in page.tags} & {"link", "iframe", "object", "embed", "base", "form"}
    assert not re.search(r"url\(|@import|fetch|XMLHttp|import\(", "".join(text for _, text in page.code))


def test_images_have_alternatives_tables_captions_and_headings_an_order():
    page = Page(report_page(report()))
    assert all(attributes["alt"] for tag, attributes in page.tags if tag == "img")
    tags = [tag for tag, _ in page.tags]
    assert tags.count("table") == tags.count("caption") > 0
    assert all("scope" in attributes for tag, attributes in page.tags if tag == "th")
    headings = [int(tag[1]) for tag in tags if re.fullmatch(r"h\d", tag)]
    assert headings[0] == 1
    assert all(next_ <= level + 1 for level, next_ in pairwise(headings))
    targets = {attributes["href"] for tag, attributes in page.tags if tag == "a"}
    assert targets - {AVATAR_PAGE} <= {f"#{attributes.get('id')}" for _, attributes in page.tags}
    assert AVATAR_PAGE in targets
    assert ("html", {"lang": "en"}) in page.tags


def test_without_a_script_all_levels_are_shown():
    page = Page(report_page(report()))
    assert [a["data-level"] for _, a in page.tags if "data-level" in a] == list(COLOURS)
    assert not any("unshown" in (a.get("class") or "") for _, a in page.tags)
    assert not any(tag == "input" for tag, _ in page.tags)


def test_a_data_uri_is_the_image():
    image = np.linspace(0, 1, 48 * 40 * 3).reshape(48, 40, 3)
    encoded = base64.b64decode(data_uri(image, 48).split(",")[1])
    decoded = cv2.imdecode(np.frombuffer(encoded, np.uint8), cv2.IMREAD_COLOR)[:, :, ::-1]
    assert np.abs(decoded / 255 - image).mean() < 0.02
    small = cv2.imdecode(np.frombuffer(base64.b64decode(data_uri(image, 12).split(",")[1]), np.uint8), 1)
    assert small.shape == (12, 10, 3)
    for shape in ((1, 20_000), (2, 20_000), (4, 33_000)):  # WebP has at most 16383 pixels in a line
        wide = cv2.imdecode(
            np.frombuffer(base64.b64decode(data_uri(plain((0, 0, 0), shape), 4).split(",")[1]), np.uint8), 1
        )
        assert 10_000 < wide.shape[1] <= 16_383


def test_images_are_reduced_then_figures_left_out_to_keep_to_the_size():
    tried = []

    def make(scale: float, with_figures: bool) -> ReportContent:
        tried.append((scale, with_figures))
        return report(noise=round(300 * scale), figures=with_figures)

    whole, bare = (len(report_page(report(noise=300, figures=figures)).encode()) for figures in (True, False))
    assert len(page_within(whole, make).encode()) == whole
    assert tried == [(1.0, True)]
    assert len(page_within((whole + bare) / 2, make).encode()) <= (whole + bare) / 2
    assert tried[-1][0] < 1 and tried[-1][1]
    assert len(page_within(bare, make).encode()) <= bare
    with pytest.warns(CarigsWarning, match="MB without figures, more than 0.0001 MB"):
        assert "<html" in page_within(100, make)
    assert not tried[-1][1] and tried[-1][0] == min(scale for scale, _ in tried)


def test_curves_are_placed_inside_the_axes_and_rise_with_the_psnr(tmp_path):
    rows = [f"{i},{i * 2.0},{i % 2},0.1,{20 + i * 0.1 + 5 * (i % 2)},100" for i in range(200)]
    header = "iteration,seconds,caricature,loss,psnr,surfels"
    (tmp_path / "log.csv").write_text("\n".join([header, *rows]))
    chart = subject_chart({"ours": tmp_path / "log.csv"})
    assert [line.name for line, _ in chart.lines] == ["ours, real frames", "ours, GT* frames"]
    for _, points in chart.lines:
        x, y = np.array([point.split(",") for point in points.split()], float).T
        assert (np.diff(x) > 0).all()
        assert (np.diff(y) <= 0).all()  # the SVG's y points down
        assert x.min() >= 0 and x.max() <= WIDTH and y.min() >= 0 and y.max() <= HEIGHT
    values = [float(tick.label) for tick in chart.up]
    assert values[0] <= 20.2 and values[-1] >= 44
    assert "39." in chart.description


@pytest.mark.parametrize("count", [0, 1, 4, 5, 30])
def test_a_moving_mean_of_a_line_lies_on_it(count):
    values = np.arange(count) * 2.0
    means = moving_mean(values)
    assert len(means) == max(count - 4, min(count, 1))
    if count:
        np.testing.assert_allclose(means, values[: len(means)] + min(count - 1, 4))


@pytest.mark.parametrize("text", ["a,b\n1,2\n", "seconds,caricature,psnr\n1,0,much\n", "seconds,caricature,psnr\n1\n"])
def test_a_broken_training_log_is_an_error(text, tmp_path):
    (tmp_path / "log.csv").write_text(text)
    with pytest.raises(InputError, match=r"log\.csv"):
        subject_chart({"ours": tmp_path / "log.csv"})


def test_an_empty_training_log_has_no_chart(tmp_path):
    (tmp_path / "log.csv").write_text("iteration,seconds,caricature,loss,psnr,surfels\n")
    assert subject_chart({"ours": tmp_path / "log.csv"}) is None
