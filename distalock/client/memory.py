"""What a client has read: the ETags that its changes quote, and answers that need not be sent again."""

from collections import OrderedDict
from collections.abc import Mapping
from typing import Final
from urllib.parse import urlsplit

from distalock.client.answer import RawAnswer
from distalock.client.call import Call

# Chosen: a console polls a handful of resources.
_MOST_KEPT: Final = 64
_MOST_KEPT_BYTES: Final = 256 * 1024
_CASES: Final = "/api/v1/cases/"


class ReadMemory:
    """Remembers ETags by path. A case's ETag is that of the last answer which showed it, or followed a change by us.

    A refusal changes nothing here: whoever was told that somebody was faster must look, and read again.
    """

    def __init__(self) -> None:
        self._etags: dict[str, str] = {}
        self._kept: OrderedDict[str, tuple[str, bytes]] = OrderedDict()

    @property
    def etags(self) -> Mapping[str, str]:
        """ETag of each path as it was read last."""
        return self._etags

    def conditions(self, call: Call[object], url: str) -> dict[str, str]:
        """`If-None-Match` for what is here already."""
        kept = self._kept.get(url) if call.reads_only else None
        return {} if kept is None else {"If-None-Match": kept[0]}

    def content(self, call: Call[object], url: str, answer: RawAnswer) -> bytes:
        """The content of an answer, also of one that says that nothing has changed; notes its ETags."""
        self._note_etags(call, answer)
        if answer.is_not_modified:
            self._kept.move_to_end(url)
            return self._kept[url][1]
        etag = answer.headers.get("etag")
        if call.reads_only and etag is not None and len(answer.content) <= _MOST_KEPT_BYTES:
            self._kept[url] = (etag, answer.content)
            self._kept.move_to_end(url)
            if len(self._kept) > _MOST_KEPT:
                self._kept.popitem(last=False)
        return answer.content

    def _note_etags(self, call: Call[object], answer: RawAnswer) -> None:
        location = urlsplit(answer.headers.get("location", "")).path
        if (etag := answer.headers.get("etag")) is not None:
            self._etags[location or call.path] = etag
        if (etag := answer.headers.get("case-etag")) is not None:
            self._etags[_case_path(call.path if call.path.startswith(_CASES) else location)] = etag


def _case_path(path: str) -> str:
    """The path of the case that a path is about."""
    return _CASES + path.removeprefix(_CASES).partition("/")[0]
