"""`docs/decisions/README.md` lists every decision record, and a long record begins with a summary."""

from pathlib import Path

import pytest

from tools.decisions_page import FOLDER, SUMMARY_FROM_WORDS, TOPICS, decisions_page, records

_LONGEST_SUMMARY_WORDS = 170


def test_the_page_is_up_to_date() -> None:
    assert (FOLDER / "README.md").read_text(encoding="utf-8") == decisions_page(), "run: make generated"


def test_every_record_is_listed_once() -> None:
    page = decisions_page()
    files = [file.name for file in FOLDER.glob("*.md") if file.name != "README.md"]
    assert len(files) > 60
    assert [name for name in files if page.count(f"]({name})") != 1] == []


def test_every_topic_has_records() -> None:
    assert {record.topic for record in records()} == set(TOPICS)


def test_a_long_record_begins_with_a_summary() -> None:
    long = [record for record in records() if len(record.text.split()) > SUMMARY_FROM_WORDS]
    assert [record.file for record in long if not record.text.startswith("**Summary.** ")] == []
    summaries = {record.file: record.text.split("\n\n")[0] for record in long}
    assert [name for name, text in summaries.items() if len(text.split()) > _LONGEST_SUMMARY_WORDS] == []


@pytest.mark.parametrize(
    ("begins", "complaint"),
    [
        ("# No number\n\nTopic: imaging\n\nText", "does not begin with a title"),
        ("# 7. No topic\n\n**Question.** Why?", "does not begin with a title"),
        ("# 8. Another number\n\nTopic: imaging\n\nText", "has the title of number 8"),
        ("# 7. Another topic\n\nTopic: weather\n\nText", "has the topic 'weather'; topics are 'localisation', "),
    ],
)
def test_a_record_that_begins_otherwise_is_named(tmp_path: Path, begins: str, complaint: str) -> None:
    (tmp_path / "0007-a-record.md").write_text(begins, encoding="utf-8")
    with pytest.raises(ValueError, match=r"0007-a-record\.md") as caught:
        records(tmp_path)
    assert complaint in str(caught.value)
