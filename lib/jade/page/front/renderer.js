// SPDX-License-Identifier: Apache-2.0
// Renders Gaussians with WebGL2: instanced quads, blended far to near in half floats, then displayed.

import { SCREEN_FRAGMENT, SCREEN_VERTEX, SPLAT_FRAGMENT, SPLAT_VERTEX, TEXTURE_WIDTH } from './shaders.js';

const DILATION = 0.3; // px² at the trained resolution
const MARGIN = 0.3; // share of the half field of view beyond each edge

export class Renderer {
  /** @throws Error that names the missing browser feature. */
  constructor(canvas, scene, background) {
    const gl = canvas.getContext('webgl2', { alpha: false, antialias: false, depth: false });
    if (!gl) throw new Error('this browser has no WebGL2');
    if (!gl.getExtension('EXT_color_buffer_float') && !gl.getExtension('EXT_color_buffer_half_float')) {
      throw new Error('this browser cannot blend in half floats');
    }
    Object.assign(this, { gl, canvas, scene, background, drawn: 0 });
    this.splat = program(gl, SPLAT_VERTEX, SPLAT_FRAGMENT);
    this.screen = program(gl, SCREEN_VERTEX, SCREEN_FRAGMENT);
    this.geometry = texture(gl, geometryRows(scene));
    this.order = gl.createBuffer();
    this.shades = gl.createBuffer();
    this.instances = gl.createVertexArray();
    gl.bindVertexArray(this.instances);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.order);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribIPointer(0, 1, gl.UNSIGNED_INT, 0, 0);
    gl.vertexAttribDivisor(0, 1);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.shades);
    gl.enableVertexAttribArray(1);
    gl.vertexAttribPointer(1, 3, gl.FLOAT, false, 0, 0);
    gl.vertexAttribDivisor(1, 1);
    this.nothing = gl.createVertexArray();
    this.current = target(gl);
    this.mean = target(gl);
  }

  /** @param sorted  result of a Sorter */
  setOrder({ order, shades, nearest, farthest }) {
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.order);
    gl.bufferData(gl.ARRAY_BUFFER, order, gl.DYNAMIC_DRAW);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.shades);
    gl.bufferData(gl.ARRAY_BUFFER, shades, gl.DYNAMIC_DRAW);
    this.drawn = order.length;
    this.range = [nearest, farthest];
  }

  /**
   * Renders into an internal picture. `scale` is rendered pixels per pixel of the camera: the low-pass filter
   * grows with it, so that the picture is the trained one, only sampled more finely.
   */
  draw(camera, pose, scale, depthMode = false) {
    const { gl, canvas, splat } = this;
    const width = Math.max(1, Math.round(camera.width * scale));
    const height = Math.max(1, Math.round(camera.height * scale));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    resize(gl, this.current, width, height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.current.frame);
    gl.viewport(0, 0, width, height);
    gl.clearColor(...(depthMode ? [0, 0, 0] : this.background), 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
    const u = splat.uniforms;
    gl.useProgram(splat.program);
    bind(gl, 0, this.geometry, u.geometry);
    gl.uniformMatrix3fv(u.rotation, true, [...pose.slice(0, 3), ...pose.slice(4, 7), ...pose.slice(8, 11)]);
    gl.uniform3f(u.translation, pose[3], pose[7], pose[11]);
    gl.uniform4f(u.intrinsics, camera.fx * scale, camera.fy * scale, camera.cx * scale, camera.cy * scale);
    gl.uniform4f(u.limits, ...ratioLimits(camera));
    gl.uniform2f(u.size, width, height);
    gl.uniform1f(u.dilation, DILATION * scale * scale);
    gl.uniform1i(u.antialiased, this.scene.antialiased);
    gl.uniform1i(u.depthMode, depthMode);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.bindVertexArray(this.instances);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, this.drawn);
    gl.disable(gl.BLEND);
  }

  /** Adds the rendered picture to a running mean as its n-th, n from 1. */
  accumulate(n) {
    const { gl, current, mean } = this;
    resize(gl, mean, current.width, current.height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, mean.frame);
    gl.enable(gl.BLEND);
    gl.blendColor(0, 0, 0, 1 / n);
    gl.blendFunc(gl.CONSTANT_ALPHA, gl.ONE_MINUS_CONSTANT_ALPHA);
    this.copy(current.texture, false);
    gl.disable(gl.BLEND);
  }

  /** Displays the rendered picture, or the mean so far. */
  show(useMean = false, depthMode = false) {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    this.copy((useMean ? this.mean : this.current).texture, depthMode);
  }

  copy(source, depthMode) {
    const { gl, screen } = this;
    gl.useProgram(screen.program);
    gl.viewport(0, 0, this.current.width, this.current.height);
    bind(gl, 0, source, screen.uniforms.picture);
    gl.uniform1i(screen.uniforms.depthMode, depthMode);
    gl.uniform2f(screen.uniforms.range, ...this.range);
    gl.bindVertexArray(this.nothing);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  /** The canvas as a data URL; call it in the task that rendered it. */
  picture() {
    return this.canvas.toDataURL('image/png');
  }
}

/** Range of x/z and y/z of points inside the picture or not far outside it. */
export function ratioLimits({ fx, fy, cx, cy, width, height }) {
  const side = (f, c, length) => {
    const margin = MARGIN * 0.5 * length / f;
    return [-(c / f + margin), (length - c) / f + margin];
  };
  return [...side(fx, cx, width), ...side(fy, cy, height)];
}

function geometryRows({ count, positions, opacities, covariances }) {
  const rows = new Float32Array(4 * TEXTURE_WIDTH * Math.max(1, Math.ceil(3 * count / TEXTURE_WIDTH)));
  for (let i = 0; i < count; ++i) {
    rows.set(positions.subarray(3 * i, 3 * i + 3), 12 * i);
    rows[12 * i + 3] = opacities[i];
    rows.set(covariances.subarray(6 * i, 6 * i + 6), 12 * i + 4);
  }
  return rows;
}

function texture(gl, rows) {
  const made = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, made);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, TEXTURE_WIDTH, rows.length / 4 / TEXTURE_WIDTH, 0, gl.RGBA, gl.FLOAT, rows);
  return made;
}

function target(gl) {
  return { texture: gl.createTexture(), frame: gl.createFramebuffer(), width: 0, height: 0 };
}

function resize(gl, into, width, height) {
  if (into.width === width && into.height === height) return;
  Object.assign(into, { width, height });
  gl.bindTexture(gl.TEXTURE_2D, into.texture);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA16F, width, height, 0, gl.RGBA, gl.HALF_FLOAT, null);
  gl.bindFramebuffer(gl.FRAMEBUFFER, into.frame);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, into.texture, 0);
}

function bind(gl, slot, what, uniform) {
  gl.activeTexture(gl.TEXTURE0 + slot);
  gl.bindTexture(gl.TEXTURE_2D, what);
  gl.uniform1i(uniform, slot);
}

function program(gl, vertex, fragment) {
  const made = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
  const uniforms = {};
  for (let k = 0; k < gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS); ++k) {
    const { name } = gl.getActiveUniform(made, k);
    uniforms[name] = gl.getUniformLocation(made, name);
  }
  return { program: made, uniforms };
}
