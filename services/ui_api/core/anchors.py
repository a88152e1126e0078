"""Anchors: countersigned heads of the chain, kept apart from the record, so that a cut end shows.

What a time-stamping authority puts into a token (RFC 3161, TSTInfo) stands here under its names: a serial number, the
time, the hash that is attested, who attests. Besides, an anchor names how many events the record had, and the hash of
the anchor before it, so that none can be left out from among the others.
"""

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Final

from services.ui_api.core.chain import GENESIS_SHA256, ChainBroken, ChainIntact

# What the first anchor names as the one before it.
NO_ANCHOR_SHA256: Final = "0" * 64
HASH_ALGORITHM: Final = "sha256"


@dataclass(frozen=True, slots=True)
class Anchor:
    """One countersigned head.

    Attributes
    ----------
    serial_number
        Counts from 1.
    gen_time
        When it was made, ISO 8601 in UTC, by the clock of whoever signed.
    hash_algorithm, hashed_message
        The head: hash of the newest event.
    events
        How many events the record had.
    tsa
        Fingerprint of the key that signed.
    previous_sha256
        Hash of the anchor before it.
    signature
        Ed25519 over the canonical JSON of all of the above, in hexadecimal.
    """

    serial_number: int
    gen_time: str
    hash_algorithm: str
    hashed_message: str
    events: int
    tsa: str
    previous_sha256: str
    signature: str = ""

    @property
    def signed_content(self) -> bytes:
        """What the signature is over."""
        return _canonical({key: value for key, value in asdict(self).items() if key != "signature"})

    @property
    def sha256(self) -> str:
        """Hash of the whole anchor, which the next one names."""
        return hashlib.sha256(_canonical(asdict(self))).hexdigest()


def next_anchor(
    before: Sequence[Anchor], chain: ChainIntact, gen_time: str, tsa: str, sign: Callable[[bytes], str]
) -> Anchor:
    """The anchor of a head, after those there are."""
    previous = before[-1].sha256 if before else NO_ANCHOR_SHA256
    unsigned = Anchor(len(before) + 1, gen_time, HASH_ALGORITHM, chain.head_sha256, chain.entries, tsa, previous)
    return replace(unsigned, signature=sign(unsigned.signed_content))


def check_anchors(
    anchors: Sequence[Anchor], hashes: Sequence[str], tsa: str, has_signed: Callable[[str, bytes], bool]
) -> ChainBroken | None:
    """Check that a record contains every head that was countersigned.

    Parameters
    ----------
    anchors
        All anchors of the record, in their order.
    hashes
        Hashes of the record's events, in their order, known to form a chain.
    tsa, has_signed
        Fingerprint of the key that must have signed, and how a signature over a content is verified.

    Returns
    -------
    ChainBroken | None
        The first finding; None when every anchor holds.
    """
    previous = NO_ANCHOR_SHA256
    for number, anchor in enumerate(anchors, 1):
        if (anchor.serial_number, anchor.previous_sha256) != (number, previous):
            return ChainBroken(anchor.events, f"anchor {number} does not follow the one before it: one was taken out")
        if anchor.tsa != tsa or not has_signed(anchor.signature, anchor.signed_content):
            return ChainBroken(anchor.events, f"anchor {number} is not signed by the key {tsa[:12]}")
        if (finding := _missed(anchor, hashes)) is not None:
            return ChainBroken(anchor.events, finding)
        previous = anchor.sha256
    return None


def _missed(anchor: Anchor, hashes: Sequence[str]) -> str | None:
    if anchor.events > len(hashes):
        return (
            f"the end was cut off: the record has {len(hashes)} events, and had {anchor.events} at {anchor.gen_time} "
            f"(anchor {anchor.serial_number})"
        )
    head = hashes[anchor.events - 1] if anchor.events else GENESIS_SHA256
    if head != anchor.hashed_message:
        return (
            f"event {anchor.events} is not the one that was there at {anchor.gen_time} (anchor "
            f"{anchor.serial_number}): the record was rewritten before it"
        )
    return None


def _canonical(content: dict[str, object]) -> bytes:
    return json.dumps(content, sort_keys=True, separators=(",", ":")).encode()
