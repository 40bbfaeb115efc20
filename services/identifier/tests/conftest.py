import sys
from pathlib import Path

# pytest imports test modules by their path, so what several of them use must be found beside them.
sys.path.insert(0, str(Path(__file__).parent))
