"""A service whose log ends, as Zenoh's does at a limit of threads, with lines that no longer name the limit."""

import os
import sys

sys.stderr.write("OS can't spawn worker thread: Resource temporarily unavailable (os error 11)\n")
for _ in range(40):
    sys.stderr.write("stack backtrace:\n" + "   0: zenoh_runtime::ZRuntime::init\n" * 20)
sys.stderr.write("thread '<unnamed>' panicked at panicking.rs\npanic in a destructor during cleanup\naborting\n")
sys.stderr.flush()
os.abort()
