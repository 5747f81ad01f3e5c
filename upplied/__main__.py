"""``python -m upplied``: the command, where no script of its name is on the path."""

import sys

from upplied.cli import main

if __name__ == "__main__":
    sys.exit(main())
