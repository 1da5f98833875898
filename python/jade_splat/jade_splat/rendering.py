# SPDX-License-Identifier: Apache-2.0
"""rasterization(), with the interface of gsplat 1.5, and splat(), the op itself."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from . import _ops
from ._library import BUILD
from .meta import Cameras, Meta, screen_numbers

_PLAIN = -1  # as a degree: colours instead of coefficients
_FARTHEST = 1e12
_MAX_ALPHA, _GSPLAT_MAX_ALPHA = 0.99, 0.999  # of a splat on a pixel, in the programs and in gsplat
_MODES = ("RGB", "D", "ED", "RGB+D", "RGB+ED")
_DEGREES = {1: 0, 4: 1, 9: 2, 16: 3}  # by the number of coefficients
_TYPES = (torch.float32, torch.float64)
_SPLAT_NAMES = ("means", "quats", "log_scales", "logit_opacities", "sh", "viewmats", "intrinsics")
_NAMES = ("means", "quats", "scales", "opacities", "colors", "viewmats", "Ks", "backgrounds")


def splat(
    means: Tensor,
    quats: Tensor,
    log_scales: Tensor,
    logit_opacities: Tensor,
    sh: Tensor,
    viewmats: Tensor,
    intrinsics: Tensor,
    width: int,
    height: int,
    *,
    sh_degree: int = 3,
    near_plane: float = 0.01,
    antialiased: bool = False,
    depth: bool = False,
    deterministic: bool = False,
    smooth_cutoff: bool = False,
) -> tuple[Tensor, Tensor, Tensor | None]:
    """The op as the programs call it: N Gaussians by their parameters before the activations, rendered for C
    cameras.

    Args:
        means: [N, 3], world.
        quats: [N, 4], wxyz, not normalised.
        log_scales: [N, 3].
        logit_opacities: [N].
        sh: [N, K, 3], K = 1, 4, 9 or 16 coefficients; the colour is max(0, SH + 0.5).
        viewmats: [C, 4, 4], from the world to the camera (x right, y down, z forward).
        intrinsics: [C, 4], fx, fy, cx, cy in px; constant.
        sh_degree: active degree; limited to that of `sh`.
        deterministic: bit-equal gradients on a GPU; on the CPU they always are.
        smooth_cutoff: for gradient tests on the CPU: the image becomes a differentiable function of every input.

    Returns:
        color [C, 3, H, W], alpha [C, 1, H, W] and, if requested, Σ w z [C, 1, H, W].
    """
    width, height = _size(width, height)
    near_plane = _number("near_plane", near_plane)
    if not near_plane > 0:
        raise ValueError(f"near_plane: expected more than 0, found {near_plane}")
    scalars = (
        width, height, _degree(sh_degree), near_plane, _FARTHEST, _MAX_ALPHA, False, antialiased, depth, smooth_cutoff,
        deterministic, False,
    )
    tensors = (means, quats, log_scales, logit_opacities, sh, viewmats, intrinsics)
    return _name_bad_tensors(_splat, _check_splat, tensors, scalars)


def _splat(tensors: tuple[Tensor, ...], scalars: tuple) -> tuple[Tensor, Tensor, Tensor | None]:
    _check_intrinsics("intrinsics", tensors[6], (tensors[5].shape[0], 4))
    _check_last_rows(tensors[5])
    most = _DEGREES[tensors[4].shape[1]]
    if scalars[2] > most:
        scalars = (*scalars[:2], most, *scalars[3:])
    return _ops.render(tensors, None, scalars)


def _check_splat(tensors: tuple[Tensor, ...], scalars: tuple) -> None:
    _check_tensors(_SPLAT_NAMES, tensors)
    means, quats, log_scales, logit_opacities, sh, viewmats, intrinsics = tensors
    if means.dim() != 2 or means.shape[1] != 3:
        raise ValueError(f"means: expected shape (N, 3), found {tuple(means.shape)}")
    count, views = means.shape[0], _views(viewmats)
    if sh.dim() != 3 or sh.shape[1] not in _DEGREES or sh.shape[::2] != (count, 3):
        raise ValueError(f"sh: expected shape ({count}, 1, 4, 9 or 16, 3), found {tuple(sh.shape)}")
    _expect("quats", quats, (count, 4))
    _expect("log_scales", log_scales, (count, 3))
    _expect("logit_opacities", logit_opacities, (count,))
    _expect("viewmats", viewmats, (views, 4, 4))
    _check_intrinsics("intrinsics", intrinsics, (views, 4))
    for name, value in zip(("antialiased", "depth", "smooth_cutoff", "deterministic"), scalars[7:]):
        if value not in (True, False, None):
            raise TypeError(f"{name}: expected True or False, found {value!r}")


def rasterization(
    means: Tensor,
    quats: Tensor,
    scales: Tensor,
    opacities: Tensor,
    colors: Tensor,
    viewmats: Tensor,
    Ks: Tensor,
    width: int,
    height: int,
    near_plane: float = 0.01,
    far_plane: float = 1e10,
    radius_clip: float = 0.0,
    eps2d: float = 0.3,
    sh_degree: int | None = None,
    packed: bool = True,
    tile_size: int = 16,
    backgrounds: Tensor | None = None,
    render_mode: str = "RGB",
    sparse_grad: bool = False,
    absgrad: bool = False,
    rasterize_mode: str = "classic",
    channel_chunk: int = 32,
    distributed: bool = False,
    camera_model: str = "pinhole",
    segmented: bool = False,
    covars: Tensor | None = None,
    with_ut: bool = False,
    with_eval3d: bool = False,
    radial_coeffs: Tensor | None = None,
    tangential_coeffs: Tensor | None = None,
    thin_prism_coeffs: Tensor | None = None,
    ftheta_coeffs: Any = None,
    rolling_shutter: Any = None,
    viewmats_rs: Tensor | None = None,
) -> tuple[Tensor, Tensor, Any]:
    """Renders N Gaussians in C cameras, with the arguments of gsplat.rasterization().

    Args:
        means: [..., N, 3], world.
        quats: [..., N, 4], wxyz, of any length.
        scales: [..., N, 3].
        opacities: [..., N], of 0 to 1. A larger one has a wider opaque middle, since alpha is capped.
        colors: [..., N, D] or [..., C, N, D] of any D and sign; with `sh_degree` coefficients [..., N, K, 3] or
            [..., C, N, K, 3].
        viewmats: [..., C, 4, 4], from the world to the camera. Another last row than 0, 0, 0, 1, as of transposed
            matrices, is refused on the CPU; on a GPU the check would wait for it.
        Ks: [..., C, 3, 3]; constant.
        packed: decides the layout of `meta` alone.
        backgrounds: [..., C, D].
        render_mode: "RGB", "D" (Σ w z), "ED" (Σ w z / Σ w), "RGB+D" or "RGB+ED".
        rasterize_mode: "classic" or "antialiased".
        tile_size, channel_chunk, segmented: accepted; the result does not depend on them.

    Returns:
        Colours [..., C, H, W, X], alphas [..., C, H, W, 1] and `meta`, in which `means2d` has a gradient after the
        backward pass. Inside torch.compile, `meta` has numbers alone.

    Raises:
        NotImplementedError: an argument that is not supported, by name.
        ValueError, TypeError: a shape, type or device that does not fit, by name.
    """
    if (
        radius_clip != 0 or eps2d != 0.3 or sparse_grad or absgrad or distributed or camera_model != "pinhole" or with_ut
        or with_eval3d or rolling_shutter is not None or covars is not None or radial_coeffs is not None
        or tangential_coeffs is not None or thin_prism_coeffs is not None or ftheta_coeffs is not None
        or viewmats_rs is not None
    ):
        _refuse(
            radius_clip=_number("radius_clip", radius_clip) > 0, eps2d=eps2d != 0.3, sparse_grad=sparse_grad,
            absgrad=absgrad, distributed=distributed, camera_model=camera_model != "pinhole", covars=covars is not None,
            with_ut=with_ut, with_eval3d=with_eval3d, radial_coeffs=radial_coeffs is not None,
            tangential_coeffs=tangential_coeffs is not None, thin_prism_coeffs=thin_prism_coeffs is not None,
            ftheta_coeffs=ftheta_coeffs is not None, viewmats_rs=viewmats_rs is not None,
            rolling_shutter=rolling_shutter is not None and getattr(rolling_shutter, "name", "") != "GLOBAL",
        )
    if render_mode not in _MODES:
        raise ValueError(f"render_mode: expected one of {', '.join(_MODES)}, found {render_mode!r}")
    if rasterize_mode not in ("classic", "antialiased"):
        raise ValueError(f"rasterize_mode: expected classic or antialiased, found {rasterize_mode!r}")
    width, height = _size(width, height)
    tile_size = _integer("tile_size", tile_size)
    if tile_size < 1:
        raise ValueError(f"tile_size: expected at least 1 px, found {tile_size}")
    sh_degree = None if sh_degree is None else _degree(sh_degree)
    near_plane, far_plane = _number("near_plane", near_plane), _number("far_plane", far_plane)
    if not 0 < near_plane < far_plane:
        raise ValueError(f"near_plane, far_plane: expected 0 < near_plane < far_plane, found {near_plane}, {far_plane}")
    tensors = (means, quats, scales, opacities, colors, viewmats, Ks, backgrounds)
    screen = (width, height, near_plane, far_plane, rasterize_mode == "antialiased")
    return _name_bad_tensors(_rasterize, _check_scene, tensors, (sh_degree, render_mode, screen, packed, tile_size))


def _rasterize(tensors: tuple[Tensor, ...], options: tuple) -> tuple[Tensor, Tensor, Any]:
    means, quats, scales, opacities, colors, viewmats, Ks, backgrounds = tensors
    sh_degree, render_mode, screen, packed, tile_size = options
    if means.dim() == 2 and colors.dim() == (2 if sh_degree is None else 3) and backgrounds is None and render_mode == "RGB":
        _check_intrinsics("Ks", Ks, (viewmats.shape[0], 3, 3))
    else:
        # The op would see only parts of these tensors.
        _check_scene(tensors, options)
    _check_last_rows(viewmats)
    width, height, near_plane, far_plane, antialiased = screen
    gaussians = (means, quats, scales, opacities)
    batch, views = means.shape[:-2], viewmats.shape[-3]
    compiling = torch.compiler.is_compiling()
    means2d = None
    if not compiling and torch.is_grad_enabled() and any([t.requires_grad for t in tensors[:-1]]):
        means2d = means.new_empty((*batch, views, means.shape[-2], 2), requires_grad=True)
    of_scenes = (*tensors[:-1], means2d)
    if not batch:
        pixels, alpha, depth_sum = _render_scene(of_scenes, sh_degree, render_mode, *screen)
    else:
        flat = [None if t is None else t.flatten(0, len(batch) - 1) for t in of_scenes]
        scenes = [
            _render_scene(tuple(None if t is None else t[b] for t in flat), sh_degree, render_mode, *screen)
            for b in range(math.prod(batch))
        ]
        pixels, alpha, depth_sum = (
            None if parts[0] is None else torch.stack(parts).unflatten(0, batch) for parts in zip(*scenes)
        )

    if pixels is not None and backgrounds is not None:
        pixels = pixels + (1 - alpha) * backgrounds[..., None, None, :]
    if depth_sum is not None and "ED" in render_mode:
        depth_sum = depth_sum / alpha.clamp(min=1e-10)
    if pixels is None:
        image = depth_sum
    else:
        image = pixels if depth_sum is None else torch.cat([pixels, depth_sum], -1)
    numbers = screen_numbers(width, height, tile_size, math.prod(batch), views)
    if compiling:
        return image, alpha, numbers
    cameras = Cameras(viewmats, Ks, width, height, near_plane, far_plane, antialiased)
    return image, alpha, Meta(numbers, gaussians, cameras, means2d, packed)


def _render_scene(
    tensors: tuple, sh_degree: int | None, mode: str, width: int, height: int, near: float, far: float,
    antialiased: bool,
) -> tuple[Tensor | None, Tensor, Tensor | None]:
    """One scene: pixels [C, H, W, D] or None, alpha [C, H, W, 1], Σ w z or None."""
    *gaussians, colors, viewmats, Ks, means2d = tensors
    per_view = colors.dim() == (3 if sh_degree is None else 4)
    channels, padding = 3, 0
    if mode in ("D", "ED"):
        groups, per_view, degree = [colors.new_zeros((gaussians[0].shape[0], 3))], False, _PLAIN
    elif sh_degree is not None:
        whole = colors.shape[-2] in _DEGREES
        groups, degree = [colors if whole else colors[..., : (sh_degree + 1) ** 2, :]], sh_degree
    else:
        channels, degree = colors.shape[-1], _PLAIN
        padding = -channels % 3
        padded = torch.nn.functional.pad(colors, (0, padding)) if padding else colors
        groups = [padded] if channels <= 3 else padded.split(3, -1)  # three channels per pass

    if per_view or len(groups) > 1:
        gaussians = [tensor.contiguous() for tensor in gaussians]  # once for all passes
    deterministic = torch.are_deterministic_algorithms_enabled()
    far = min(far, _FARTHEST)
    passes = []
    for index, group in enumerate(groups):
        depth = index == 0 and mode != "RGB"
        scalars = (
            width, height, degree, near, far, _GSPLAT_MAX_ALPHA, True, antialiased, depth, False, deterministic, True,
        )
        if per_view:
            parts = []
            for v in range(viewmats.shape[0]):
                pose, K, screen = (None if t is None else t[v : v + 1] for t in (viewmats, Ks, means2d))
                parts.append(_ops.render((*gaussians, group[v], pose, K), screen, scalars))
            passes.append(tuple(None if images[0] is None else torch.cat(images) for images in zip(*parts)))
        else:
            passes.append(_ops.render((*gaussians, group, viewmats, Ks), means2d, scalars))
    pixels, alpha, depth_sum = passes[0]
    if len(passes) > 1:
        pixels = torch.cat([images[0] for images in passes], -1)
    if padding:
        pixels = pixels[..., :channels]
    return (None if mode in ("D", "ED") else pixels), alpha, depth_sum


def _refuse(**used: bool) -> None:
    for name, is_used in used.items():
        if is_used:
            raise NotImplementedError(f"{name}: not supported by jade_splat.rasterization; leave its default")


def _name_bad_tensors(render: Callable, check: Callable, tensors: tuple[Tensor, ...], options: tuple) -> tuple:
    """Returns render(tensors, options). If that fails, check(tensors, options) raises the error that names the tensor.

    The op checks its inputs anyway, and checks in Python would delay its first kernel by 4 µs. While torch.compile
    traces, the op does not run.
    """
    if torch.compiler.is_compiling():
        check(tensors, options)
        return render(tensors, options)
    try:
        images = render(tensors, options)
        if images[1].is_meta:  # from torch's own implementation for shapes, which checks nothing
            raise ValueError("means: expected a tensor on the CPU or a CUDA device, found one on meta")
        return images
    except Exception:
        try:
            check(tensors, options)
        except Exception as problem:
            raise problem from None
        raise


def _check_last_rows(viewmats: Tensor) -> None:
    """Refuses transposed matrices on the CPU. On a GPU the check would wait for it."""
    if (
        viewmats.device.type != "cpu" or type(viewmats) not in (Tensor, torch.nn.Parameter) or viewmats.dim() < 3
        or viewmats.shape[-2:] != (4, 4) or torch.compiler.is_compiling()
    ):
        return
    matrices = viewmats.detach().tolist()  # no operation of torch, which would take longer
    for _ in range(viewmats.dim() - 3):
        matrices = [matrix for scene in matrices for matrix in scene]
    for matrix in matrices:
        if max(abs(found - wanted) for found, wanted in zip(matrix[3], (0, 0, 0, 1))) > 1e-4:
            raise ValueError(
                f"viewmats: expected 0, 0, 0, 1 as the last row of each matrix, found {matrix[3]}; if the matrices are "
                "transposed, pass their .mT"
            )


def _check_intrinsics(name: str, tensor: Tensor, shape: tuple[int, ...]) -> None:
    """The op takes both matrices and rows."""
    _expect(name, tensor, shape)
    if tensor.requires_grad:
        raise NotImplementedError(f"{name}: gradients of intrinsics are not supported; pass {name}.detach()")


def _size(width: Any, height: Any) -> tuple[int, int]:
    width, height = _integer("width", width), _integer("height", height)
    if not (0 < width < 32768 and 0 < height < 32768):
        raise ValueError(f"width, height: expected 1 to 32767 px, found {width} and {height}")
    return width, height


def _degree(sh_degree: Any) -> int:
    sh_degree = _integer("sh_degree", sh_degree)
    if not 0 <= sh_degree <= 3:
        raise ValueError(f"sh_degree: expected 0 to 3, found {sh_degree}")
    return sh_degree


def _integer(name: str, value: Any) -> int:
    """Integers of any type, such as NumPy's and tensors of one element. Rejects floats, even whole ones."""
    if isinstance(value, int):
        return value
    try:
        return operator.index(value)
    except (TypeError, ValueError):
        raise TypeError(f"{name}: expected an integer, found {value!r}") from None


def _number(name: str, value: Any) -> float:
    if isinstance(value, (int, float)):
        return value
    try:
        if isinstance(value, str):
            raise TypeError
        return float(value)
    except (TypeError, ValueError, RuntimeError):
        raise TypeError(f"{name}: expected a number, found {value!r}") from None


def _views(viewmats: Tensor) -> int:
    if viewmats.dim() < 3 or viewmats.shape[-3] < 1:
        raise ValueError(f"viewmats: expected shape (..., C, 4, 4) with C of at least 1, found {tuple(viewmats.shape)}")
    return viewmats.shape[-3]


def _check_tensors(names: tuple[str, ...], tensors: tuple[Tensor, ...]) -> None:
    """Means come first; the others must match them."""
    means = tensors[0]
    if not isinstance(means, Tensor):
        raise TypeError(f"{names[0]}: expected a tensor, found {type(means).__name__}")
    device, dtype = means.device, means.dtype
    if dtype not in _TYPES:
        raise TypeError(f"means: expected float32, found {str(dtype)[6:]}; call .float()")
    for name, tensor in zip(names, tensors):
        if not isinstance(tensor, Tensor):
            raise TypeError(f"{name}: expected a tensor, found {type(tensor).__name__}")
        if tensor.layout != torch.strided:
            raise TypeError(f"{name}: expected a dense tensor, found {str(tensor.layout)[6:]}; call .to_dense()")
        if tensor.device != device:
            raise ValueError(f"{name}: expected a tensor on {device}, as means, found one on {tensor.device}")
        if tensor.dtype != dtype:
            if tensor.dtype not in _TYPES:
                raise TypeError(f"{name}: expected float32, found {str(tensor.dtype)[6:]}; call .float()")
            raise TypeError(f"{name}: expected {str(dtype)[6:]}, as means, found {str(tensor.dtype)[6:]}")
    if means.is_cuda:
        if BUILD["cuda"] is None:
            raise RuntimeError(
                "means: this jade_splat has no CUDA kernels; install the wheel for your CUDA or use the CPU"
            )
        if dtype == torch.float64:
            raise TypeError("means: expected float32 on a GPU, found float64; render doubles on the CPU")
    elif device.type != "cpu":
        raise ValueError(f"means: expected a tensor on the CPU or a CUDA device, found one on {device}")


def _expect(name: str, tensor: Tensor, shape: tuple[int, ...]) -> None:
    if tensor.shape != shape:
        raise ValueError(f"{name}: expected shape {shape}, found {tuple(tensor.shape)}")


def _check_scene(tensors: tuple[Tensor, ...], options: tuple) -> None:
    _check_tensors(_NAMES, tensors if tensors[-1] is not None else tensors[:-1])
    means, quats, scales, opacities, colors, viewmats, Ks, backgrounds = tensors
    sh_degree = options[0]
    if means.dim() < 2 or means.shape[-1] != 3:
        raise ValueError(f"means: expected shape (..., N, 3), found {tuple(means.shape)}")
    *batch, count, _ = means.shape
    if 0 in batch:
        raise ValueError(f"means: expected at least one scene in the batch, found shape {tuple(means.shape)}")
    views = _views(viewmats)
    _expect("quats", quats, (*batch, count, 4))
    _expect("scales", scales, (*batch, count, 3))
    _expect("opacities", opacities, (*batch, count))
    _expect("viewmats", viewmats, (*batch, views, 4, 4))
    _check_intrinsics("Ks", Ks, (*batch, views, 3, 3))
    tail = 1
    if sh_degree is not None:
        tail = 2
        if colors.dim() < 2 or colors.shape[-1] != 3 or colors.shape[-2] < (sh_degree + 1) ** 2:
            raise ValueError(
                f"colors: expected (..., K, 3) with K of at least {(sh_degree + 1) ** 2}, found {tuple(colors.shape)}"
            )
    if tuple(colors.shape[:-tail]) not in ((*batch, count), (*batch, views, count)) or colors.shape[-1] < 1:
        raise ValueError(
            f"colors: expected {(*batch, count)} or {(*batch, views, count)} and {tail} more axes, "
            f"found {tuple(colors.shape)}"
        )
    if backgrounds is not None:
        _expect("backgrounds", backgrounds, (*batch, views, 3 if sh_degree is not None else colors.shape[-1]))
