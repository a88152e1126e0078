"""First receipts: an image that is offered or sent again does not become younger."""

from pathlib import Path

import pytest

from services.imaging.devices.image_store import ImageStore
from services.imaging.service import receipts
from services.imaging.service.receipts import Receipts
from shared.messages.base import encode
from shared.messages.imaging import FrameHeader
from tests.unit.services.registration.outside import header


def age_s(kept: Receipts, one: FrameHeader, now_s: float) -> float | None:
    return kept.with_age(one, now_s).age_s


@pytest.fixture
def store(tmp_path: Path) -> ImageStore:
    return ImageStore(tmp_path)


def test_the_first_receipt_counts(store: ImageStore) -> None:
    kept, one = Receipts(store), header("one")
    assert age_s(kept, one, 100.0) is None
    kept.note(one.sha256, "1.2.3", 100.0)
    kept.note(one.sha256, "1.2.3", 104.0)
    assert age_s(kept, one, 105.0) == 5.0
    assert age_s(kept, one, 99.0) == 0.0, "published by a thread that asked the clock earlier"


@pytest.mark.parametrize("first_s", [100.0, None])
def test_another_file_with_the_same_uid_is_as_old(store: ImageStore, first_s: float | None) -> None:
    kept, one, other = Receipts(store), header("one"), header("corrected")
    assert not kept.note(one.sha256, "1.2.3", first_s)
    assert kept.note(other.sha256, "1.2.3", 104.0)
    assert not kept.note(header("next").sha256, "1.2.4", 104.0)
    assert age_s(kept, other, 105.0) == (first_s and 5.0)
    assert age_s(kept, header("next"), 105.0) == 1.0


def test_nobody_knows_the_age_of_another_file_with_the_uid_of_an_image_from_before_this_run(store: ImageStore) -> None:
    one, other = header("one"), header("corrected")
    store.index.add(1, one.sha256, encode(one), in_run=False)
    kept = Receipts(store)
    kept.note(other.sha256, one.sop_instance_uid, 104.0)
    kept.note(header("next").sha256, "1.2.4", 104.0)
    assert age_s(kept, other, 105.0) is None
    assert age_s(kept, header("next"), 105.0) == 1.0


def test_one_of_unknown_age_does_not_get_one_by_being_sent_again(store: ImageStore) -> None:
    kept, one = Receipts(store), header("one")
    kept.note(one.sha256, "1.2.3", None)
    kept.note(one.sha256, "1.2.3", 104.0)
    assert age_s(kept, one, 105.0) is None


def test_nobody_knows_the_age_of_an_image_from_before_this_run_also_of_one_without_a_number(store: ImageStore) -> None:
    kept, sha256 = Receipts(store), store.put(b"content")
    kept.note(sha256, "1.2.3", 100.0)
    assert age_s(kept, header("one").model_copy(update={"sha256": sha256}), 105.0) is None


def test_an_image_that_was_forgotten_has_no_age(store: ImageStore, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(receipts, "_KEPT", 4)
    kept, names = Receipts(store), ("one", "two", "three")
    for number, name in enumerate(names, start=1):
        kept.note(header(name).sha256, f"1.2.{number}", 100.0)
        store.index.add(number, header(name).sha256, b"", in_run=False)
    assert [age_s(kept, header(name), 105.0) for name in names] == [None, 5.0, 5.0]
    kept.note(header("one").sha256, "1.2.1", 104.0)
    assert age_s(kept, header("one"), 105.0) is None


class FailingStore(ImageStore):
    """Cannot be asked whether it has an image."""

    failing = True

    def has(self, sha256: str, sop_instance_uid: str) -> bool:
        if self.failing:
            raise OSError(5, "Input/output error")
        return super().has(sha256, sop_instance_uid)


def test_an_image_of_which_nobody_could_say_whether_it_is_from_before_has_no_age(tmp_path: Path) -> None:
    store = FailingStore(tmp_path)
    kept, one = Receipts(store), header("one")
    with pytest.raises(OSError, match="Input/output error"):
        kept.note(one.sha256, "1.2.3", 100.0)
    store.failing = False
    kept.note(one.sha256, "1.2.3", 104.0)
    assert age_s(kept, one, 105.0) is None
