#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes assets/identity_response.npy, the initial camera response of training.

    scripts/identity_response.py [--output assets/identity_response.npy]

Fits rho(x) = sigmoid(0.1 MLP(x) + x), MLP 1-16-16-16-1 with ReLU, to x on [0,1): 3000 Adam steps at 1e-2, mean
squared error of 192 uniform samples, seed 42. Every operation is float32 in a fixed order, so that the same
libraries give the same bits. The file is one float32 vector: weight and bias of each layer in turn, 593 numbers.
Needs NumPy and PyTorch (its generator), about 10 s.
"""
import argparse
import ctypes
from pathlib import Path

import numpy as np
import torch

SIZES = (1, 16, 16, 16, 1)
BATCH, STEPS, SEED = 64 * 3, 3000, 42
RATE, BETA1, BETA2, EPS = (np.float32(v) for v in (1e-2, 0.9, 0.999, 1e-8))
GAIN, ONE, ZERO = np.float32(0.1), np.float32(1), np.float32(0)

LIBM = ctypes.CDLL("libm.so.6")
LIBM.expf.restype, LIBM.expf.argtypes = ctypes.c_float, [ctypes.c_float]
LIBM.powf.restype, LIBM.powf.argtypes = ctypes.c_float, [ctypes.c_float, ctypes.c_float]


def exp(values: np.ndarray) -> np.ndarray:
    return np.array([LIBM.expf(value) for value in values], np.float32)


def summed(values: np.ndarray) -> np.ndarray:
    """Sums over the last axis in order; np.sum adds in another order."""
    return np.cumsum(values, axis=-1, dtype=np.float32)[..., -1]


class Adam:
    def __init__(self, start: torch.Tensor):
        self.value = start.numpy().copy()
        self.first, self.second = np.zeros_like(self.value), np.zeros_like(self.value)

    def step(self, gradient: np.ndarray, correction1: np.float32, correction2: np.float32) -> None:
        self.first = BETA1 * self.first + (ONE - BETA1) * gradient
        self.second = BETA2 * self.second + (ONE - BETA2) * gradient * gradient
        self.value -= RATE * (self.first / correction1) / (np.sqrt(self.second / correction2) + EPS)


class Layer:
    """W x + b of [neurons][batch], with ReLU unless it is the last layer."""

    def __init__(self, inputs: int, outputs: int, relu: bool, generator: torch.Generator):
        bound = 1 / inputs**0.5
        self.weight = Adam(torch.empty(outputs, inputs).uniform_(-bound, bound, generator=generator))
        self.bias = Adam(torch.empty(outputs).uniform_(-bound, bound, generator=generator))
        self.relu = relu

    def forward(self, values: np.ndarray) -> np.ndarray:
        self.input = values
        self.output = np.repeat(self.bias.value[:, None], BATCH, axis=1)
        for i, row in enumerate(values):
            self.output += self.weight.value[:, i : i + 1] * row
        if self.relu:
            self.output = np.maximum(self.output, ZERO)
        return self.output

    def backward(self, delta: np.ndarray) -> np.ndarray:
        if self.relu:
            delta = np.where(self.output > 0, delta, ZERO)
        self.gradients = summed(delta[:, None] * self.input[None]), summed(delta)
        into = np.zeros_like(self.input)
        for o, row in enumerate(delta):
            into += self.weight.value[o][:, None] * row
        return into

    def step(self, *corrections: np.float32) -> None:
        self.weight.step(self.gradients[0], *corrections)
        self.bias.step(self.gradients[1], *corrections)


def fitted() -> np.ndarray:
    generator = torch.Generator().manual_seed(SEED)
    last = len(SIZES) - 2
    layers = [Layer(SIZES[i], SIZES[i + 1], i < last, generator) for i in range(last + 1)]
    for step in range(1, STEPS + 1):
        x = torch.rand(BATCH, generator=generator).numpy()
        values = x[None]
        for layer in layers:
            values = layer.forward(values)
        rho = ONE / (ONE + exp(-(GAIN * values[0] + x)))
        delta = (np.float32(2) / np.float32(BATCH) * (rho - x) * rho * (ONE - rho) * GAIN)[None]
        for layer in reversed(layers):
            delta = layer.backward(delta)
        for layer in layers:
            layer.step(*(ONE - np.float32(LIBM.powf(beta, step)) for beta in (BETA1, BETA2)))
    return np.concatenate([part.value.ravel() for layer in layers for part in (layer.weight, layer.bias)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path(__file__).resolve().parents[1] / "assets" / "identity_response.npy")
    np.save(parser.parse_args().output, fitted())


if __name__ == "__main__":
    main()
