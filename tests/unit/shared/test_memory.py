"""Threads share their arenas: in a process of its own, because the allocator's settings stay."""

import subprocess
import sys

PROGRAM = """
import ctypes, re, threading
from shared.memory import share_arenas
from pathlib import Path
SHARED and share_arenas()
library = ctypes.CDLL(None)
library.malloc.restype = ctypes.c_void_p
library.malloc.argtypes = [ctypes.c_size_t]
together = threading.Barrier(12)
def allocate():
    together.wait()
    library.malloc(1000)
    together.wait()
threads = [threading.Thread(target=allocate) for _ in range(12)]
[t.start() for t in threads]
[t.join() for t in threads]
sizes = re.findall(r"^([0-9a-f]+)-([0-9a-f]+) ---p", Path("/proc/self/maps").read_text(), re.M)
print(sum(int(end, 16) - int(begin, 16) > 2**25 for begin, end in sizes))
"""


def arenas(shared: str) -> int:
    program = PROGRAM.replace("SHARED", shared)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return int(done.stdout)


def test_threads_share_one_arena_beside_the_main_thread_s() -> None:
    assert arenas("True") <= 1
    assert arenas("False") >= 4  # each reserves 64 MiB, of which it uses little
