"""`python -m jaxsim` is the command line."""

import sys

from jaxsim.cli import main

sys.exit(main())
