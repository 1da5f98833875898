# SPDX-License-Identifier: Apache-2.0
"""Tests of identity_response.py: it fits the identity, and the shipped file is its output."""
import sys
import unittest
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "scripts"))
import identity_response  # noqa: E402


def response(weights: np.ndarray, x: np.ndarray) -> np.ndarray:
    """sigmoid(0.1 MLP(x) + x) in float64."""
    hidden, at, last = x[None], 0, len(identity_response.SIZES) - 2
    for i in range(last + 1):
        inputs, outputs = identity_response.SIZES[i : i + 2]
        weight = weights[at : at + inputs * outputs].reshape(outputs, inputs)
        at += inputs * outputs
        hidden = weight @ hidden + weights[at : at + outputs, None]
        at += outputs
        hidden = np.maximum(hidden, 0) if i < last else hidden
    return 1 / (1 + np.exp(-(0.1 * hidden[0] + x)))


class IdentityResponse(unittest.TestCase):
    def test_the_file_is_the_fit_and_the_fit_is_the_identity(self):
        shipped = np.load(ROOT / "assets" / "identity_response.npy")
        self.assertEqual((shipped.dtype, shipped.shape), (np.float32, (593,)))
        x = np.linspace(0, 1, 101)
        error = np.abs(response(shipped.astype(np.float64), x) - x)
        self.assertLess(error.mean(), 1e-2)
        self.assertLess(error.max(), 5e-2)
        # Another C library may round exp and pow differently, and 3000 steps amplify that.
        fitted = identity_response.fitted().astype(np.float64)
        self.assertLess(np.abs(response(fitted, x) - response(shipped.astype(np.float64), x)).max(), 5e-3)


if __name__ == "__main__":
    unittest.main()
