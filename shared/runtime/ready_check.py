"""The gateway's health check: `python -I -S shared/runtime/ready_check.py https://.../readyz AUTHORITY`; 0 when ready.

Answered by 200 with a certificate of the authority in the file that is named. Apart from `health`, for it imports three
times as much.
"""

import http.client
import signal
import ssl
import sys
from typing import Final
from urllib.parse import urlsplit

# Before docker gives it up, and lets it run.
_ENDS_WITHIN_S: Final = 4
# Chosen: less than that.
_ANSWER_WITHIN_S: Final = 3.0
_OK: Final = 200


def why_not_ready(url: str, authority: str | None = None) -> str:
    """What is wrong with what answers at an address; empty when it is ready."""
    address = urlsplit(url)
    host = address.hostname or ""
    connection = http.client.HTTPConnection(host, address.port, timeout=_ANSWER_WITHIN_S)
    try:
        if address.scheme == "https":
            context = ssl.create_default_context(cafile=authority)
            connection = http.client.HTTPSConnection(host, address.port, timeout=_ANSWER_WITHIN_S, context=context)
        connection.request("GET", address.path)
        answer = connection.getresponse()
        content = answer.read().decode(errors="replace")
    except (http.client.HTTPException, OSError) as error:
        return f"{url}: {type(error).__name__}: {error}"
    finally:
        connection.close()
    return "" if answer.status == _OK else content


if __name__ == "__main__":
    signal.alarm(_ENDS_WITHIN_S)
    not_ready = why_not_ready(*sys.argv[1:3])
    print(not_ready or "ready")  # noqa: T201 - what `docker inspect` shows
    sys.exit(1 if not_ready else 0)
