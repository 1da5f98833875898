# SPDX-License-Identifier: Apache-2.0
"""The two compiled ops, connected for autograd, and their shapes for torch.compile."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.autograd import forward_ad

from . import _library  # noqa: F401 (registers the ops)

forward = torch.ops.jade_splat.forward.default
backward = torch.ops.jade_splat.backward.default

_INPUTS = 7  # of the forward op before means2d
_GAUSSIANS = 5  # of these, before the cameras
_COLORS = 4
_TILE = 32  # px, of the lists on the CPU
_SPLAT_BYTES = {torch.float32: 64, torch.float64: 120}  # of a record on the CPU
_DEPTH = 8  # among the scalars


def contiguous(tensor: Tensor) -> Tensor:
    """Tensor.contiguous() that calls the dispatcher only if it must copy."""
    return tensor if tensor.is_contiguous() else tensor.contiguous()


def _contiguous(grad: Tensor | None) -> Tensor | None:
    return None if grad is None else contiguous(grad)


def _gradients(saved, cleared, grads, scalars, needs):
    """Gradients of the seven inputs and means2d; None if not needed."""
    *found, on_cameras, on_means2d = backward(*saved, cleared, *grads, *scalars, needs[_GAUSSIANS], needs[_INPUTS])
    found = [grad if needed else None for grad, needed in zip(found, needs)]
    return (
        *found,
        on_cameras if needs[_GAUSSIANS] else None,
        None,  # intrinsics
        on_means2d if needs[_INPUTS] else None,
    )


class _Render(torch.autograd.Function):
    """Connects the two ops in eager mode. register_autograd(), which torch.compile needs, costs 150 µs more on the
    host.
    """

    @staticmethod
    def forward(ctx, *arguments):
        *inputs, means2d, scalars = arguments
        flat = inputs[_COLORS].dim() == 2
        if flat:
            inputs[_COLORS] = inputs[_COLORS].unsqueeze(1)
        with torch._C._AutoDispatchBelowAutograd():
            color, alpha, depth_sum, _, *state = forward(*inputs, means2d, *scalars, True)
        ctx.set_materialize_grads(False)
        ctx.save_for_backward(*inputs, color, alpha, depth_sum, *state)
        # On a GPU the third tensor is memory that the forward pass has zeroed for one backward pass.
        ctx.cleared = state[2] if color.is_cuda else None
        ctx.scalars, ctx.flat = scalars, flat
        return color, alpha, depth_sum if scalars[_DEPTH] else None

    @staticmethod
    def backward(ctx, *grads):
        # Only a graph of the gradients needs the guards of once_differentiable(), which take time.
        return (_backward_once if torch.is_grad_enabled() else _backward_eager)(ctx, *grads)


def _backward_eager(ctx, *grads):
    cleared, ctx.cleared = ctx.cleared, None
    grads = [_contiguous(grad) for grad in grads]
    with torch._C._AutoDispatchBelowAutograd():
        found = _gradients(ctx.saved_tensors, cleared, grads, ctx.scalars, ctx.needs_input_grad)
    if ctx.flat and found[_COLORS] is not None:
        found = (*found[:_COLORS], found[_COLORS].squeeze(1), *found[_COLORS + 1 :])
    return (*found, None)


_backward_once = torch.autograd.function.once_differentiable(_backward_eager)


def _refuse_tangents(inputs: tuple[Tensor, ...]) -> None:
    """Forward-mode differentiation would take the image for a constant."""
    if any(forward_ad.unpack_dual(tensor).tangent is not None for tensor in inputs):
        raise NotImplementedError(
            "jade_splat: expected inputs without tangents, found some; jvp() and forward_ad are not supported, call "
            "backward() or torch.autograd.grad()"
        )


def render(inputs: tuple[Tensor, ...], means2d: Tensor | None, scalars: tuple) -> tuple[Tensor, Tensor, Tensor | None]:
    """Colour, alpha and, if requested, Σ w z of contiguous inputs; colours may be [N, 3] as well as [N, K, 3].

    `scalars` are those of the ops up to `interleaved`. The gradient of means2d [C, N, 2] is dL/dmeans2d, in px.
    """
    needs_backward = torch.is_grad_enabled() and any([tensor.requires_grad for tensor in inputs])
    compiling = torch.compiler.is_compiling()
    if not compiling and forward_ad._current_level >= 0:
        _refuse_tangents(inputs)
    if needs_backward and not compiling:
        return _Render.apply(*inputs, means2d, scalars)
    if inputs[_COLORS].dim() == 2:
        inputs = (*inputs[:_COLORS], inputs[_COLORS].unsqueeze(1), *inputs[_COLORS + 1 :])
    color, alpha, depth_sum, *_ = forward(*inputs, means2d, *scalars, needs_backward)
    return color, alpha, depth_sum if scalars[_DEPTH] else None


def _setup_context(ctx, inputs, output) -> None:
    color, alpha, depth_sum, _, *state = output
    ctx.set_materialize_grads(False)
    ctx.save_for_backward(*inputs[:_INPUTS], color, alpha, depth_sum, *state)
    ctx.scalars = inputs[_INPUTS + 1 : -1]


def _backward(ctx, grad_color, grad_alpha, grad_depth_sum, *_):
    grads = [_contiguous(grad_color), _contiguous(grad_alpha), _contiguous(grad_depth_sum)]
    if not ctx.scalars[_DEPTH]:
        grads[2] = None
    # A compiled graph may run its parts more than once, so it cannot use memory that was zeroed once.
    found = _gradients(ctx.saved_tensors, None, grads, ctx.scalars, ctx.needs_input_grad)
    return (*found, *[None] * (len(ctx.scalars) + 1))


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
    means2d,
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
    views, count = viewmats.shape[0], means.shape[0]

    def images(channels):
        return means.new_empty((views, height, width, channels) if interleaved else (views, channels, height, width))

    color, alpha = images(3), images(1)
    depth_sum = images(1) if depth else means.new_empty((0,))
    rejected = means.new_empty((1,), dtype=torch.int64)

    def unknown(dtype):
        return means.new_empty((torch.library.get_ctx().new_dynamic_size(),), dtype=dtype)

    nothing = [means.new_empty((0,)) for _ in range(4)]
    if not needs_backward:
        state = nothing
    elif means.is_cuda:
        state = [unknown(torch.uint8), unknown(torch.int64), unknown(torch.uint8), nothing[3]]
    else:
        tiles = ((width - 1) // _TILE + 1) * ((height - 1) // _TILE + 1)
        state = [
            means.new_empty((views * count * _SPLAT_BYTES[means.dtype],), dtype=torch.uint8),
            unknown(torch.int32),
            means.new_empty((views, tiles + 1), dtype=torch.int64),
            means.new_empty((views + 1,), dtype=torch.int64),
        ]
    return (color, alpha, depth_sum, rejected, *state)


@torch.library.register_fake("jade_splat::backward")
def _(means, quats, scales, opacities, colors, viewmats, *others):
    needs_camera, needs_means2d = others[-2:]
    views, count = viewmats.shape[0], means.shape[0]
    return (
        *[torch.empty_like(tensor) for tensor in (means, quats, scales, opacities, colors)],
        torch.empty_like(viewmats) if needs_camera else means.new_empty((0,)),
        means.new_empty((views, count, 2)) if needs_means2d else means.new_empty((0,)),
    )
