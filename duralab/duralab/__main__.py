"""`python -m duralab`: the same as the command `duralab`."""

from duralab.cli import main

if __name__ == "__main__":
    main()
