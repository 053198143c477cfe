"""The stage `html`: a page whose clip has the first timesteps of the capture."""

from __future__ import annotations

import json
import re

import pytest
from avatars import TIMESTEPS, ball_avatar

from carigs.cli import export
from carigs.errors import SettingsError
from carigs.settings import Html
from carigs.splat.avatar import save_avatar
from carigs.stages.html import html
from carigs.viewer.html import page as html_page


def header(page) -> dict:
    return json.loads(re.search(r'id="header">(.*?)</script>', page.read_text("utf-8"))[1])


@pytest.fixture(scope="module")
def avatar(tmp_path_factory):
    file = tmp_path_factory.mktemp("avatar") / "avatar.npz"
    save_avatar(file, ball_avatar(sh_degree=0, lit=False))
    return file


def test_the_clip_has_the_first_timesteps(avatar, tmp_path, monkeypatch):
    for most in (2, 99):
        monkeypatch.setattr(html_page, "CLIP_LENGTH", most)
        html(Html(), avatar=avatar, title="ball", page=tmp_path / "page.html")
        made = header(tmp_path / "page.html")
        assert made["timesteps"] == list(range(min(most, TIMESTEPS)))
        assert made["fps"] == 24


@pytest.mark.parametrize(
    ("arguments", "timesteps", "sliders", "level"),
    [
        ([], [0, 1, 2], [], 0.125),
        (["--timesteps", "1:", "--slider", "face", "--slider", "neck"], [1, 2], ["face", "neck"], 0.125),
        (["--timesteps", "2,0", "--level", "0.25"], [2, 0], [], 0.25),
    ],
)
def test_the_command_writes_a_page(avatar, tmp_path, capsys, arguments, timesteps, sliders, level):
    page = tmp_path / "head.html"
    assert export.main([str(avatar), str(page), *arguments]) == 0
    made = header(page)
    assert made["timesteps"] == timesteps and made["firstLevel"] == level
    assert [region["name"] for region in made["regions"]] == sliders
    assert "600 surfels" in capsys.readouterr().out
    assert "<title>head</title>" in page.read_text("utf-8")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["page.html", "--timesteps", "first"], "FIRST:LAST"),
        (["page.html", "--timesteps", "7"], "timestep 7"),
        (["page.html", "--timesteps", "7:9"], "no timestep"),
        (["page.html", "--region", "face=0.2"], "--region"),
        (["page.html", "--timestep", "1"], "--timestep"),
        (["clip.webp", "--slider", "face"], "--slider"),
        (["clip.webp", "--timesteps", "0:1"], "--timesteps"),
    ],
)
def test_mistakes_are_one_line(avatar, tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SettingsError, match=words):
        export.main([str(avatar), *arguments])
    assert not list(tmp_path.iterdir())
