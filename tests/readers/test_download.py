"""Downloads: an interrupted one goes on where it was, and ends with the same bytes."""

from __future__ import annotations

import urllib.error
import urllib.request

import pytest
from web import Web

from carigs.errors import InputError
from carigs.readers.download import download

URL = "https://example.org/weights.pth"
CONTENT = bytes(range(256)) * 9000  # more than two blocks


@pytest.fixture
def web(monkeypatch):
    web = Web(CONTENT)
    monkeypatch.setattr(urllib.request, "urlopen", web.open)
    return web


def test_the_content_arrives_and_its_growth_is_reported(web, tmp_path):
    reports = []
    download(URL, tmp_path / "file", 1 << 30, lambda done, total: reports.append((done, total)))
    assert (tmp_path / "file").read_bytes() == CONTENT
    assert [done for done, _ in reports] == [1 << 20, 2 << 20, len(CONTENT)]
    assert {total for _, total in reports} == {len(CONTENT)}


@pytest.mark.parametrize("sends_parts", [True, False])
def test_a_broken_connection_is_continued(web, tmp_path, sends_parts):
    file = tmp_path / "file"
    web.breaks_after = 1000
    with pytest.raises(InputError, match=f"the connection ended after 1000 of {len(CONTENT)} bytes"):
        download(URL, file, 1 << 30)
    web.breaks_after, web.sends_parts = None, sends_parts
    download(URL, file, 1 << 30)
    assert file.read_bytes() == CONTENT
    assert [wanted for _, wanted in web.asked] == [None, "bytes=1000-"]


def test_a_download_that_was_complete_stays_as_it_is(web, tmp_path):
    (tmp_path / "file").write_bytes(CONTENT)
    download(URL, tmp_path / "file", 1 << 30)
    assert (tmp_path / "file").read_bytes() == CONTENT


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"error": urllib.error.URLError("Name or service not known")}, "cannot be downloaded .Name or service"),
        ({"error": urllib.error.HTTPError(URL, 401, "Unauthorized", None, None)}, "HTTP 401 Unauthorized"),
        ({"error": TimeoutError("timed out")}, "cannot be downloaded .timed out"),
        ({"address": "http://example.org/weights.pth"}, "redirected to an address that is not https"),
        ({"content": bytes(2001)}, "more than 2000 bytes"),
    ],
)
def test_what_goes_wrong_is_one_line_with_the_address(web, tmp_path, changes, says):
    vars(web).update(changes)
    with pytest.raises(InputError, match=f"{URL}: .*{says}"):
        download(URL, tmp_path / "file", 2000)


def test_nothing_but_https_is_downloaded(web, tmp_path):
    for url in ("http://example.org/weights.pth", "file:///etc/passwd"):
        with pytest.raises(InputError, match="only https"):
            download(url, tmp_path / "file", 2000)
    assert web.asked == []
