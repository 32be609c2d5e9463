"""`python -m pdjax` is the command `pdjax`."""

import sys

from .cli import main

if __name__ == "__main__":
    sys.exit(main())
