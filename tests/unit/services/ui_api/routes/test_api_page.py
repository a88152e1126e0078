"""The API page shows every operation, runs nothing and loads nothing."""

import base64
import hashlib
import re

from services.ui_api.api_document.page import page_of
from tests.unit.services.ui_api.room import Room


def test_the_page_shows_every_operation_without_a_login_and_loads_nothing(room: Room) -> None:
    answer = room.client.get("/docs", headers={"Authorization": ""})
    assert answer.status_code == 200
    for path, methods in room.client.get("/openapi.json").json()["paths"].items():
        for operation in methods.values():
            assert f'id="{operation["operationId"]}"' in answer.text
        assert f"<code>{path}</code>" in answer.text
    assert not re.search(r"<script|<img|<link|\bsrc=|https?://(?!127)", answer.text)
    policy = answer.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    (style,) = re.findall(r"<style>(.*?)</style>", answer.text, re.DOTALL)
    assert base64.b64encode(hashlib.sha256(style.encode()).digest()).decode() in policy
    for target in re.findall(r'href="#([^"]+)"', answer.text):
        assert f'id="{target}"' in answer.text, target


def test_what_a_document_says_is_text_and_no_markup() -> None:
    operation = {
        "operationId": "x",
        "description": "<b>bold</b>",
        "responses": {"200": {"description": "<i>", "links": {"x": {"description": "<u>"}}}},
        "parameters": [{"name": "<a>", "in": "query", "required": True}],
    }
    document: dict[str, object] = {
        "info": {"title": "<t>", "summary": "s"},
        "paths": {"/<p>": {"get": operation}},
        "components": {"examples": {"x": {"value": "<script>"}}},
    }
    page = page_of(document)
    assert not re.search(r"<(b|i|u|a|t|p|script)>(bold|$)", page.replace("<p>", ""))
    assert "&lt;script&gt;" in page
    assert "/&lt;p&gt;" in page
