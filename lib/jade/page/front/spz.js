// SPDX-License-Identifier: Apache-2.0
// Reads the page's compressed Gaussians: .spz version 2, as gaussians/spz_file.h writes it.

const MAGIC = 0x5053474e;
const SH_BYTES = 48; // 16 coefficients of 3 channels

/** Decodes base64 and decompresses gzip. */
export async function gunzipBase64(text) {
  const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream('gzip'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/**
 * Gaussians in this library's axes (x right, y down, z forward): positions [3N], opacities [N], the upper
 * triangle of their covariances [6N] (xx xy xz yy yz zz), and colours [48N] as bytes. The colours are those
 * of the file, whose SH refer to directions in its own axes (x right, y up, z back).
 */
export function parseSpz(bytes) {
  const header = new DataView(bytes.buffer, bytes.byteOffset, Math.min(16, bytes.length));
  if (bytes.length < 16 || header.getUint32(0, true) !== MAGIC || header.getUint32(4, true) !== 2) {
    throw new Error('expected .spz of version 2, found something else');
  }
  const count = header.getUint32(8, true);
  const degree = header.getUint8(12);
  const rest = 3 * ((degree + 1) ** 2 - 1);
  if (degree > 3 || bytes.length !== 16 + count * (19 + rest)) {
    throw new Error(`expected ${count} Gaussians in ${16 + count * (19 + rest)} bytes, found ${bytes.length}`);
  }
  const alphas = 16 + 9 * count;
  const colors = alphas + count;
  const scales = colors + 3 * count;
  const rotations = scales + 3 * count;
  const sh = rotations + 3 * count;
  const scene = {
    count,
    degree,
    antialiased: (header.getUint8(14) & 1) === 1,
    positions: readPositions(bytes, count, 2 ** -header.getUint8(13)),
    opacities: new Float32Array(count),
    covariances: new Float32Array(6 * count),
    colors: new Uint8Array(SH_BYTES * count).fill(128),
  };
  for (let i = 0; i < count; ++i) {
    scene.opacities[i] = bytes[alphas + i] / 255;
    writeCovariance(bytes, scales + 3 * i, rotations + 3 * i, scene.covariances, 6 * i);
    const to = SH_BYTES * i;
    scene.colors.set(bytes.subarray(colors + 3 * i, colors + 3 * i + 3), to);
    scene.colors.set(bytes.subarray(sh + rest * i, sh + rest * (i + 1)), to + 3);
  }
  return scene;
}

function readPositions(bytes, count, unit) {
  const positions = new Float32Array(3 * count);
  for (let k = 0, at = 16; k < 3 * count; ++k, at += 3) {
    const fixed = (bytes[at] | (bytes[at + 1] << 8) | (bytes[at + 2] << 16)) << 8 >> 8;
    positions[k] = (k % 3 === 0 ? unit : -unit) * fixed;
  }
  return positions;
}

/** Σ = R diag(s²) Rᵀ, with y and z converted to this library's axes. */
function writeCovariance(bytes, scale, rotation, out, to) {
  const s = [0, 1, 2].map((k) => Math.exp(2 * (bytes[scale + k] / 16 - 10)));
  const x = bytes[rotation] / 127.5 - 1;
  const y = 1 - bytes[rotation + 1] / 127.5;
  const z = 1 - bytes[rotation + 2] / 127.5;
  const w = Math.sqrt(Math.max(0, 1 - x * x - y * y - z * z));
  const r = [
    1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
    2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
    2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
  ];
  for (let i = 0, k = to; i < 3; ++i) {
    for (let j = i; j < 3; ++j, ++k) {
      out[k] = r[3 * i] * s[0] * r[3 * j] + r[3 * i + 1] * s[1] * r[3 * j + 1] + r[3 * i + 2] * s[2] * r[3 * j + 2];
    }
  }
}
