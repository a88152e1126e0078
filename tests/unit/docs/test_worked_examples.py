"""The worked examples in the documents are run as they stand."""

import doctest
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[3] / "docs"


@pytest.mark.parametrize("page", ["geometry.md"])
def test_examples_of_a_page_hold(page: str) -> None:
    failures, attempted = doctest.testfile(str(DOCS / page), module_relative=False, verbose=False)
    assert attempted >= 8
    assert failures == 0
