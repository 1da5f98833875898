// SPDX-License-Identifier: Apache-2.0
// The splatting op (splat/math) as a vertex and a fragment shader.

/** Texels per row of the texture: a multiple of three, the texels per Gaussian. */
export const TEXTURE_WIDTH = 1536;

export const SPLAT_VERTEX = `#version 300 es
precision highp float; precision highp int; precision highp sampler2D;
uniform sampler2D geometry;   // per Gaussian: mean, opacity | Sigma xx xy xz yy | Sigma yz zz
uniform mat3 rotation;        // camera_from_world
uniform vec3 translation;
uniform vec4 intrinsics;      // fx fy cx cy, px of the rendered picture
uniform vec4 limits;          // range of x/z (xy) and y/z (zw) at which the Jacobian is evaluated
uniform vec2 size;
uniform float dilation;       // px^2
uniform bool antialiased, depthMode;
layout(location = 0) in uint index;
layout(location = 1) in vec3 shade;
out vec2 offset;              // in standard deviations along the ellipse's axes
flat out vec4 paint;          // colour, opacity

void main() {
  gl_Position = vec4(2.0, 2.0, 2.0, 1.0);  // outside the clip space, which culls the Gaussian
  int texel = int(index) * 3;
  ivec2 at = ivec2(texel % ${TEXTURE_WIDTH}, texel / ${TEXTURE_WIDTH});
  vec4 a = texelFetch(geometry, at, 0), b = texelFetch(geometry, at + ivec2(1, 0), 0);
  vec2 c = texelFetch(geometry, at + ivec2(2, 0), 0).xy;
  mat3 covariance = mat3(b.x, b.y, b.z, b.y, b.w, c.x, b.z, c.x, c.y);
  vec3 point = rotation * a.xyz + translation;
  vec2 ratio = clamp(point.xy / point.z, limits.xz, limits.yw);
  vec2 focal = intrinsics.xy / point.z;
  mat3 world = transpose(rotation);
  vec3 tx = focal.x * (world[0] - ratio.x * world[2]), ty = focal.y * (world[1] - ratio.y * world[2]);
  vec3 sx = covariance * tx, sy = covariance * ty;
  float xx = dot(tx, sx), xy = dot(tx, sy), yy = dot(ty, sy);
  float bare = max(xx * yy - xy * xy, 0.0);
  xx += dilation;
  yy += dilation;
  float det = max(xx * yy - xy * xy, dilation * dilation);
  float opacity = antialiased ? a.w * sqrt(bare / det) : a.w;
  if (opacity < 1.0 / 255.0) return;
  float middle = 0.5 * (xx + yy), spread = length(vec2(0.5 * (xx - yy), xy));
  float large = middle + spread, small = det / large;
  float angle = spread > 1e-7 * middle ? 0.5 * atan(2.0 * xy, xx - yy) : 0.0;
  vec2 major = vec2(cos(angle), sin(angle));
  vec2 corner = vec2(float(gl_VertexID & 1), float(gl_VertexID >> 1)) * 2.0 - 1.0;
  offset = corner * sqrt(2.0 * log(255.0 * opacity));
  vec2 pixel = intrinsics.xy * point.xy / point.z + intrinsics.zw + offset.x * sqrt(large) * major +
               offset.y * sqrt(small) * vec2(-major.y, major.x);
  paint = vec4(depthMode ? vec3(point.z, 0.0, 1.0) : shade, opacity);
  gl_Position = vec4(pixel / size * vec2(2.0, -2.0) + vec2(-1.0, 1.0), 0.0, 1.0);
}`;

export const SPLAT_FRAGMENT = `#version 300 es
precision highp float;
in vec2 offset;
flat in vec4 paint;
out vec4 result;
void main() {
  float alpha = min(0.99, paint.a * exp(-0.5 * dot(offset, offset)));
  if (alpha < 1.0 / 255.0) discard;
  result = vec4(paint.rgb * alpha, alpha);
}`;

export const SCREEN_VERTEX = `#version 300 es
void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }`;

/** Copies one picture to another of its size: unchanged, or depth as gray with near bright. */
export const SCREEN_FRAGMENT = `#version 300 es
precision highp float; precision highp sampler2D;
uniform sampler2D picture;
uniform bool depthMode;
uniform vec2 range;
out vec4 result;
void main() {
  vec4 value = texelFetch(picture, ivec2(gl_FragCoord.xy), 0);
  if (depthMode) {
    float depth = value.r / max(value.b, 1e-4);
    value.rgb = vec3(value.b < 1e-3 ? 0.0 : clamp(log(range.y / depth) / log(range.y / range.x), 0.0, 1.0));
  }
  result = vec4(value.rgb, 1.0);
}`;
