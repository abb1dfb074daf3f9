"""``python -m annik_ros.node_bench``."""

import sys

from annik_ros.node_bench.command import main

if __name__ == "__main__":
    sys.exit(main())
