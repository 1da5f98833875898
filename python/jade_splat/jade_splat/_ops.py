# SPDX-License-Identifier: Apache-2.0
"""The two compiled ops, connected for autograd, and their shapes for torch.compile."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.autograd import forward_ad

from . import _library  # noqa: F401 (registers the ops)

forward = torch.ops.jade_splat.forward.default
backward = torch.ops.jade_splat.backward.default

_GAUSSIANS, _INPUTS = 5, 7  # number of inputs: Gaussians, and these with cameras
_TILE = 32  # px, of the lists on the CPU
_SPLAT_BYTES = {torch.float32: 64, torch.float64: 120}  # of a record on the CPU
_DEPTH = 8  # among the scalars
_is_contiguous = Tensor.is_contiguous


def _gradients(saved, cleared, grads, scalars, needs_camera, needs_means2d):
    """Gradients of the seven inputs and means2d."""
    grads = [grad if grad is None or grad.is_contiguous() else grad.contiguous() for grad in grads]
    *found, on_cameras, on_means2d = backward(saved, cleared, *grads, *scalars, needs_camera, needs_means2d)
    return (*found, on_cameras if needs_camera else None, None, on_means2d if needs_means2d else None)


class _Render(torch.autograd.Function):
    """Connects the two ops in eager mode. register_autograd(), which torch.compile needs, costs 150 µs more on the
    host.
    """

    @staticmethod
    def forward(ctx, *arguments):
        *inputs, _, scalars = arguments
        with torch._C._AutoDispatchBelowAutograd():
            outputs = forward(*inputs, *scalars, True)
        # On a GPU the last tensor is memory that the forward pass has zeroed for one backward pass.
        ctx.cleared = outputs.pop() if outputs[0].is_cuda else None
        ctx.scalars = scalars
        ctx.set_materialize_grads(False)
        ctx.save_for_backward(*inputs, *outputs)
        return outputs[0], outputs[1], outputs[2] if scalars[_DEPTH] else None

    @staticmethod
    def backward(ctx, *grads):
        if torch.is_grad_enabled():
            # Only a graph of the gradients needs these guards, which take time.
            return _backward_once(ctx, *grads)
        cleared, ctx.cleared = ctx.cleared, None
        needs = ctx.needs_input_grad
        with torch._C._AutoDispatchBelowAutograd():
            found = _gradients(ctx.saved_tensors, cleared, grads, ctx.scalars, needs[_GAUSSIANS], needs[_INPUTS])
        return (*found, None)


_backward_once = torch.autograd.function.once_differentiable(_Render.backward)
# Function.apply() without its part for torch.func, which takes 3 µs and which render() refuses.
_apply = super(torch.autograd.Function, _Render).apply


def _refuse_tangents(inputs: Sequence[Tensor]) -> None:
    """Forward-mode differentiation would take the image for a constant."""
    if any(forward_ad.unpack_dual(tensor).tangent is not None for tensor in inputs):
        raise NotImplementedError(
            "jade_splat: expected inputs without tangents, found some; jvp() and forward_ad are not supported, call "
            "backward() or torch.autograd.grad()"
        )


def render(inputs: Sequence[Tensor], means2d: Tensor | None, scalars: tuple) -> tuple[Tensor, Tensor, Tensor | None]:
    """Colour, alpha and, if requested, Σ w z; colours may be [N, 3] as well as [N, K, 3].

    `scalars` are those of the ops up to `interleaved`. The gradient of means2d [C, N, 2] is dL/dmeans2d, in px.
    """
    if not all(map(_is_contiguous, inputs)):
        inputs = [tensor.contiguous() for tensor in inputs]
    needs_backward = torch.is_grad_enabled() and any([tensor.requires_grad for tensor in inputs])
    if torch.compiler.is_compiling():
        outputs = forward(*inputs, *scalars, needs_backward)
    else:
        if forward_ad._current_level >= 0:
            _refuse_tangents(inputs)
        if torch._C._are_functorch_transforms_active():
            raise NotImplementedError(
                "jade_splat: expected a call outside of torch.func and torch.vmap, found one inside; they are not "
                "supported, call backward() or torch.autograd.grad()"
            )
        if needs_backward:
            return _apply(*inputs, means2d, scalars)
        with torch._C._AutoDispatchBelowAutograd():
            outputs = forward(*inputs, *scalars, False)
    return outputs[0], outputs[1], outputs[2] if scalars[_DEPTH] else None


def _setup_context(ctx, inputs, output) -> None:
    ctx.set_materialize_grads(False)
    # A compiled graph may run its parts more than once, so it cannot use memory that was zeroed once.
    ctx.save_for_backward(*inputs[:_INPUTS], *(output[:-1] if output[0].is_cuda else output))
    ctx.scalars = inputs[_INPUTS:-1]


def _backward(ctx, grads):
    grads = [*grads[: 3 if ctx.scalars[_DEPTH] else 2], None][:3]
    found = _gradients(ctx.saved_tensors, None, grads, ctx.scalars, ctx.needs_input_grad[_GAUSSIANS], False)
    return (*found[:_INPUTS], *[None] * (len(ctx.scalars) + 1))


torch.library.register_autograd("jade_splat::forward", _backward, setup_context=_setup_context)


@torch.library.register_fake("jade_splat::forward")
def _(
    means,
    quats,
    scales,
    opacities,
    colors,
    viewmats,
    intrinsics,
    width,
    height,
    sh_degree,
    near_plane,
    far_plane,
    max_alpha,
    activated,
    antialiased,
    depth,
    smooth_cutoff,
    deterministic,
    interleaved,
    needs_backward,
):
    if any(t.device != means.device for t in (quats, scales, opacities, colors, viewmats, intrinsics)):
        raise ValueError("jade_splat: expected tensors on one device, found several")  # one on meta beside others
    views, count = viewmats.shape[0], means.shape[0]

    def images(channels):
        return means.new_empty((views, height, width, channels) if interleaved else (views, channels, height, width))

    outputs = [images(3), images(1), *([images(1)] if depth else [])]

    def unknown(dtype):
        return means.new_empty((torch.library.get_ctx().new_dynamic_size(),), dtype=dtype)

    if not needs_backward:
        return outputs
    if means.is_cuda:
        return [*outputs, unknown(torch.uint8), unknown(torch.int64), unknown(torch.uint8)]
    tiles = ((width - 1) // _TILE + 1) * ((height - 1) // _TILE + 1)
    return [
        *outputs,
        means.new_empty((views * count * _SPLAT_BYTES[means.dtype],), dtype=torch.uint8),
        unknown(torch.int32),
        means.new_empty((views, tiles + 1), dtype=torch.int64),
        means.new_empty((views + 1,), dtype=torch.int64),
    ]


@torch.library.register_fake("jade_splat::backward")
def _(saved, *others):
    means, viewmats = saved[0], saved[_GAUSSIANS]
    needs_camera, needs_means2d = others[-2:]
    return (
        *[torch.empty_like(tensor) for tensor in saved[:_GAUSSIANS]],
        torch.empty_like(viewmats) if needs_camera else means.new_empty((0,)),
        means.new_empty((viewmats.shape[0], means.shape[0], 2)) if needs_means2d else means.new_empty((0,)),
    )
