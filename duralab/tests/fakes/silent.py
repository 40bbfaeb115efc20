"""Never comes to the bus."""

import sys

sys.stderr.write("still warming up\n")
sys.stderr.flush()
sys.stdin.read()
