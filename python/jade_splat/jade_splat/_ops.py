# SPDX-License-Identifier: Apache-2.0
"""The two compiled ops, joined for autograd, with shapes for torch.compile."""

from __future__ import annotations

import torch
from torch import Tensor

from . import _library  # noqa: F401 (registers the ops)

forward = torch.ops.jade_splat.forward.default
backward = torch.ops.jade_splat.backward.default

_INPUTS = 7  # of the forward op before means2d
_GAUSSIANS = 5  # of these, before the cameras
_TILE = 32  # px, of the lists on the CPU
_SPLAT_BYTES = {torch.float32: 64, torch.float64: 120}  # of a record on the CPU


def _setup_context(ctx, inputs, output) -> None:
    color, alpha, depth_sum, rejected, *state = output
    ctx.set_materialize_grads(False)
    # In the third place a GPU has memory that its forward pass has cleared for one backward pass. A graph that torch
    # compiles may run its parts more than once, and is traced with tensors of another class.
    ctx.cleared = state[2].detach() if color.is_cuda and type(color) is Tensor else None
    ctx.save_for_backward(*inputs[:_INPUTS], color, alpha, depth_sum, *state)
    ctx.scalars = inputs[_INPUTS + 1 : -1]


def _backward(ctx, grad_color, grad_alpha, grad_depth_sum, *_):
    def contiguous(grad):
        return None if grad is None else grad.contiguous()

    cleared, ctx.cleared = ctx.cleared, None
    needs = ctx.needs_input_grad
    *grads, on_cameras, on_means2d = backward(
        *ctx.saved_tensors,
        cleared,
        contiguous(grad_color),
        contiguous(grad_alpha),
        contiguous(grad_depth_sum) if ctx.scalars[7] else None,
        *ctx.scalars,
        needs[_GAUSSIANS],
        needs[_INPUTS],
    )
    grads = [grad if needed else None for grad, needed in zip(grads, needs)]
    grads += [
        on_cameras if needs[_GAUSSIANS] else None,
        None,  # intrinsics
        on_means2d if needs[_INPUTS] else None,
    ]
    return (*grads, *[None] * (len(ctx.scalars) + 1))


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
    activated,
    antialiased,
    depth,
    smooth_cutoff,
    deterministic,
    needs_backward,
):
    views, count = viewmats.shape[0], means.shape[0]
    color = means.new_empty((views, 3, height, width))
    alpha = means.new_empty((views, 1, height, width))
    depth_sum = means.new_empty((views, 1, height, width)) if depth else means.new_empty((0,))
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
