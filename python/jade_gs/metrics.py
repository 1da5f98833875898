# SPDX-License-Identifier: Apache-2.0
"""jade_metrics: makes the networks of LPIPS that jade_eval and jade_train load, once (64 MB to fetch)."""

import runpy
import sys

from jade_gs.launch import SHARE


def main() -> None:
    sys.argv[0] = "jade_metrics"
    runpy.run_path(str(SHARE / "scripts" / "export_lpips.py"), run_name="__main__")
