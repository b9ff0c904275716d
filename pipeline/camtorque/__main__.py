"""`python -m camtorque`: the command where its script is not on the path."""

import sys

from camtorque.cli import main

if __name__ == "__main__":  # a second process imports this file under another name
    sys.exit(main())
