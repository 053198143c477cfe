"""`python -m carigs` is the command `carigs`."""

import sys

from carigs.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
