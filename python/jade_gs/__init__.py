# SPDX-License-Identifier: Apache-2.0
"""The programs of JADE-GS as a Python package: jade_train, jade_import, jade_view and the others, and jade_demo."""

from jade_gs.build import VERSION as __version__

__all__ = ["__version__"]
