"""`python -m skin`: the command `skin`."""

import sys

from skin.cli import main

if __name__ == "__main__":
    sys.exit(main())
