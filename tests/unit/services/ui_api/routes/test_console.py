"""`/`: the console's files, their headers, and what is said where they are missing."""

import gzip
import re
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from services.ui_api.routes.console_files import INDEX, console_files
from tests.unit.services.ui_api.room import Room


@pytest.fixture
def nobody(quiet_room: Room) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=quiet_room.client.base_url, timeout=quiet_room.client.timeout) as client:
        yield client


def test_the_page_is_loaded_without_a_login_and_allows_nothing_unsafe(nobody: httpx.Client) -> None:
    page = nobody.get("/")
    assert page.status_code == 200
    assert page.headers["content-type"] == "text/html; charset=utf-8"
    policy = page.headers["content-security-policy"]
    assert "unsafe" not in policy
    assert "default-src 'none'" in policy
    assert "frame-ancestors 'none'" in policy
    assert not re.search(r"https?:", page.text), "the page names another address"
    assert not re.search(r"<style|<script(?! type=\"module\" crossorigin src=)", page.text), "inline code"


@pytest.mark.parametrize("path", ["/", "/docs"])
def test_a_page_that_is_loaded_again_keeps_its_policy(nobody: httpx.Client, path: str) -> None:
    """What a 304 says of it takes the place of what the browser kept."""
    first = nobody.get(path)
    again = nobody.get(path, headers={"If-None-Match": first.headers["etag"]})
    assert again.status_code == 304
    assert again.headers["content-security-policy"] == first.headers["content-security-policy"]


def test_assets_are_compressed_kept_for_good_and_have_their_types(nobody: httpx.Client) -> None:
    names = re.findall(r"/assets/[\w.-]+", nobody.get("/").text)
    assert len(names) >= 3
    for name in names:
        plain = nobody.get(name, headers={"Accept-Encoding": "identity"})
        zipped = nobody.get(name, headers={"Accept-Encoding": "gzip"})
        assert plain.status_code == zipped.status_code == 200
        assert zipped.headers["content-encoding"] == "gzip"
        assert plain.content == zipped.content, "httpx unpacks it"
        assert plain.headers["cache-control"] == "public, max-age=31536000, immutable"
        assert plain.headers["content-type"].startswith(("text/", "image/svg"))


@pytest.mark.parametrize("name", ["missing.js", "../index.html", "..%2findex.html", "%2e%2e/%2e%2e/package.json"])
def test_nothing_else_is_served(nobody: httpx.Client, name: str) -> None:
    answer = nobody.get(f"/assets/{name}")
    assert answer.status_code == 404


def test_files_are_read_with_their_types(tmp_path: Path) -> None:
    (tmp_path / "assets").mkdir()
    (tmp_path / INDEX).write_text("<html>")
    (tmp_path / ".built-of").write_text("a hash")
    (tmp_path / "assets" / "page-1a2b.js").write_text("let a")
    (tmp_path / "assets" / "voice.woff2").write_bytes(b"\0\1")
    files = console_files(tmp_path)
    assert sorted(files) == ["assets/page-1a2b.js", "assets/voice.woff2", INDEX]
    assert files["assets/page-1a2b.js"].media_type == "text/javascript; charset=utf-8"
    assert gzip.decompress(files["assets/page-1a2b.js"].zipped or b"") == b"let a"
    assert files["assets/voice.woff2"].zipped is None
    assert console_files(tmp_path / "nowhere") == {}
