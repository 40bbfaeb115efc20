import os
import platform
import subprocess
import sys

import pytest

from duralab_bus import keep_few_arenas

# Eight threads hold memory at once; the C library itself says how many heaps it has then.
SCRIPT = """
import ctypes, sys, threading
from duralab_bus import keep_few_arenas
if sys.argv[1] != "0":
    assert keep_few_arenas(int(sys.argv[1]))
begun = threading.Barrier(9)
def hold():
    held = [bytearray(30_000) for _ in range(10)]
    begun.wait()
    begun.wait()
threads = [threading.Thread(target=hold) for _ in range(8)]
for thread in threads: thread.start()
begun.wait()
libc = ctypes.CDLL(None)
libc.fdopen.restype = ctypes.c_void_p
out = ctypes.c_void_p(libc.fdopen(1, b"w"))
libc.malloc_info(0, out)
libc.fflush(out)
begun.wait()
"""


def heaps(most):
    done = subprocess.run([sys.executable, "-c", SCRIPT, str(most)], check=True, capture_output=True, text=True)
    return done.stdout.count("<heap nr=")


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only the GNU C library has heaps of threads")
def test_threads_share_the_heaps_that_are_asked_for():
    assert heaps(0) > 3
    assert heaps(2) == 2


# Arrays of 1 MiB come and go; the system counts the pages that it gave.
FAULTS = """
import resource, sys
from duralab_bus import keep_few_arenas
if sys.argv[1] == "kept":
    assert keep_few_arenas(2, kept_bytes=2**24)
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(200):
    bytearray(2**20)
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only the GNU C library has these bounds")
def test_freed_memory_is_kept_also_where_the_environment_has_it_returned():
    environment = {**os.environ, "MALLOC_TRIM_THRESHOLD_": "65536"}

    def faults(kept):
        command = [sys.executable, "-c", FAULTS, kept]
        done = subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
        return int(done.stdout)

    assert faults("returned") > 100 * 256
    assert faults("kept") < 10 * 256


def test_no_heap_at_all_is_refused():
    with pytest.raises(ValueError, match="0 heaps are asked for"):
        keep_few_arenas(0)
