# SPDX-License-Identifier: Apache-2.0
"""jade_metrics: creates the LPIPS networks that jade_eval and jade_train load, once (64 MB download)."""

import sys

from jade_gs.launch import SHARE


def main() -> int:
    sys.argv[0] = "jade_metrics"  # argparse takes the program's name from here
    sys.path.insert(0, str(SHARE / "scripts"))
    import export_lpips

    return export_lpips.main()
