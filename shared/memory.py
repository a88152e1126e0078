"""What a process that runs for days asks of the C library's allocator.

The GNU C library gives threads arenas of their own, eight for each processor. What one thread frees in its arena is of
no use to the others, so that the memory of a process with many threads grows for hours although it holds no more.
"""

import ctypes
from typing import Final

_M_ARENA_MAX: Final = -8  # of <malloc.h>
# Chosen: one for the main thread, one for all others, which hardly ever allocate at the same moment.
_ARENAS: Final = 2


def share_arenas() -> bool:
    """Let the threads of this process share two arenas; whether the C library can do that."""
    try:
        return bool(ctypes.CDLL(None).mallopt(_M_ARENA_MAX, _ARENAS))
    except AttributeError:  # another library than GNU's
        return False
