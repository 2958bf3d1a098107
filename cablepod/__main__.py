"""``python -m cablepod`` is the command ``cablepod``."""

import sys

from cablepod.cli import main

sys.exit(main())
