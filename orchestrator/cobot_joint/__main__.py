"""`python -m cobot_joint`: the command line, where its script is not on the path."""

from __future__ import annotations

from cobot_joint.cli import main

main()
