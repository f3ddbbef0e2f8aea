"""`python -m swarm_mj`: the command line."""

import sys

from swarm_mj.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
