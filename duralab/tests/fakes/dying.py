import sys

sys.stderr.write("first line\nthe oil is cold.\n")
sys.exit(3)
