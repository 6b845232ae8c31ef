"""Runs the command `beamid` as `python -m beamid`."""
import sys

from beamid_command import main

sys.exit(main())
