"use strict";
// Surfels on the posed mesh: Jacobian blend skinning (`carigs.splat.rig.jacobian_blend`), colours seen from the eye
// (`carigs.splat.colour.appearance`), and the order of their depths.

const SH_BASE = 0.28209479177387814;
const OPACITY_THRESHOLD = 1 / 255, NEAR_PLANE = 0.01;
const FLOATS = 16;  // of a surfel in the texture: centre, tangents, log2 of the opacity, colour, and three that are unused

/** Values of the spherical harmonics of degrees 1 to 3 (Kerbl et al. 2023). */
function harmonics(x, y, z, count, b) {
  const A = 0.4886025119029199, B = 1.0925484305920792, C = 0.31539156525252005, D = 0.5462742152960396;
  const E = 0.5900435899266435, F = 2.890611442640554, G = 0.4570457994644658, H = 0.3731763325901154;
  const I = 1.445305721320277, xx = x * x, yy = y * y, zz = z * z;
  b[0] = -A * y; b[1] = A * z; b[2] = -A * x;
  if (count < 8) return;
  b[3] = B * x * y; b[4] = -B * y * z; b[5] = C * (2 * zz - xx - yy); b[6] = -B * x * z; b[7] = D * (xx - yy);
  if (count < 15) return;
  b[8] = -E * y * (3 * xx - yy); b[9] = F * x * y * z; b[10] = -G * y * (4 * zz - xx - yy);
  b[11] = H * z * (2 * zz - 3 * xx - 3 * yy); b[12] = -G * x * (4 * zz - xx - yy); b[13] = I * z * (xx - yy);
  b[14] = -E * x * (xx - 3 * yy);
}

class Surfels {
  constructor(data, header, rig) {
    this.rig = rig;
    this.first = new Int32Array(rig.count + 1);  // of the surfels of each triangle
    data.rows("surfels").forEach((count, f) => { this.first[f + 1] = this.first[f] + count; });
    const n = (this.count = this.first[rig.count]);
    this.blend = data.rows("blend");
    this.opacity = data.rows("opacity");
    this.colour = data.rows("colour");
    this.harmonics = data.rows("harmonics");
    this.coefficients = n ? this.harmonics.length / (3 * n) : 0;
    this.turns = this.coefficients > 0 && header.rotateHarmonics;
    this.face = new Int32Array(n);
    for (let f = 0; f < rig.count; f++) this.face.fill(f, this.first[f], this.first[f + 1]);
    this.local = this.localVectors(data);
    this.world = new Float32Array(9 * n);  // centre, tangents
    this.rotation = new Float32Array(this.turns ? 9 * n : 0);
    this.seen = new Float32Array(3 * n);
    this.log2Opacity = Float32Array.from(this.opacity, Math.log2);
    this.sorter = new DepthSorter(n);
  }

  /** Centre and tangents of each surfel on the canonical mesh, relative to the centre of its triangle: K mu, K r s. */
  localVectors(data) {
    const { rig, face, count } = this, local = new Float32Array(9 * count), q = new Float64Array(4);
    const position = data.rows("position"), largest = data.rows("largest"), three = data.rows("rotation");
    const scale = data.rows("log_scale"), parts = new Float64Array(9);
    for (let i = 0; i < count; i++) {
      let sum = 0, next = 3 * i;
      for (let c = 0; c < 4; c++) if (c !== largest[i]) { q[c] = three[next++]; sum += q[c] * q[c]; }
      q[largest[i]] = Math.sqrt(Math.max(1 - sum, 0));
      const norm = 1 / Math.hypot(q[0], q[1], q[2], q[3]);
      const w = q[0] * norm, x = q[1] * norm, y = q[2] * norm, z = q[3] * norm;
      const su = Math.exp(scale[2 * i]), sv = Math.exp(scale[2 * i + 1]);
      for (let c = 0; c < 3; c++) parts[c] = position[3 * i + c];
      parts[3] = su * (1 - 2 * (y * y + z * z)); parts[4] = su * 2 * (x * y + w * z); parts[5] = su * 2 * (x * z - w * y);
      parts[6] = sv * 2 * (x * y - w * z); parts[7] = sv * (1 - 2 * (x * x + z * z)); parts[8] = sv * 2 * (y * z + w * x);
      const k = 9 * face[i], unit = rig.scale[face[i]];
      for (let v = 0; v < 9; v += 3) for (let c = 0; c < 3; c++) {
        const frame = rig.frames;
        local[9 * i + v + c] =
          unit * (frame[k + c] * parts[v] + frame[k + 3 + c] * parts[v + 1] + frame[k + 6 + c] * parts[v + 2]);
      }
    }
    return local;
  }

  /** Carry the surfels to the posed mesh: J_b = U exp(sum v_i log(U^T U_i)) sum v_i P_i; without P_i for kept sizes. */
  skin() {
    const { rig, first, blend, local, world, turns } = this, { stretch, rotation, turn, centre, neighbours } = rig;
    const q = this.rotation;
    for (let f = 0; f < rig.count; f++) {
      const start = first[f], stop = first[f + 1];
      if (start === stop) continue;
      const p = 6 * f, u = 9 * f, one = 6 * neighbours[3 * f], two = 6 * neighbours[3 * f + 1], three = 6 * neighbours[3 * f + 2];
      const u0 = rotation[u], u1 = rotation[u + 1], u2 = rotation[u + 2], u3 = rotation[u + 3], u4 = rotation[u + 4];
      const u5 = rotation[u + 5], u6 = rotation[u + 6], u7 = rotation[u + 7], u8 = rotation[u + 8];
      const tx = centre[3 * f], ty = centre[3 * f + 1], tz = centre[3 * f + 2], kept = rig.kept[f];
      for (let i = start; i < stop; i++) {
        const v1 = blend[3 * i], v2 = blend[3 * i + 1], v3 = blend[3 * i + 2], v0 = 1 - v1 - v2 - v3;
        const pxx = v0 * stretch[p] + v1 * stretch[one] + v2 * stretch[two] + v3 * stretch[three];
        const pxy = v0 * stretch[p + 1] + v1 * stretch[one + 1] + v2 * stretch[two + 1] + v3 * stretch[three + 1];
        const pxz = v0 * stretch[p + 2] + v1 * stretch[one + 2] + v2 * stretch[two + 2] + v3 * stretch[three + 2];
        const pyy = v0 * stretch[p + 3] + v1 * stretch[one + 3] + v2 * stretch[two + 3] + v3 * stretch[three + 3];
        const pyz = v0 * stretch[p + 4] + v1 * stretch[one + 4] + v2 * stretch[two + 4] + v3 * stretch[three + 4];
        const pzz = v0 * stretch[p + 5] + v1 * stretch[one + 5] + v2 * stretch[two + 5] + v3 * stretch[three + 5];
        const x = v1 * turn[u] + v2 * turn[u + 3] + v3 * turn[u + 6];
        const y = v1 * turn[u + 1] + v2 * turn[u + 4] + v3 * turn[u + 7];
        const z = v1 * turn[u + 2] + v2 * turn[u + 5] + v3 * turn[u + 8];
        const t = x * x + y * y + z * z;
        let a, b;  // sin(t) / t, (1 - cos t) / t^2
        if (t < 0.1) {
          a = 1 - (t / 6) * (1 - (t / 20) * (1 - (t / 42) * (1 - t / 72)));
          b = 0.5 - (t / 24) * (1 - (t / 30) * (1 - (t / 56) * (1 - t / 90)));
        } else {
          const angle = Math.sqrt(t);
          a = Math.sin(angle) / angle;
          b = (1 - Math.cos(angle)) / t;
        }
        const e0 = 1 - b * (y * y + z * z), e4 = 1 - b * (x * x + z * z), e8 = 1 - b * (x * x + y * y);
        const e1 = b * x * y - a * z, e3 = b * x * y + a * z, e2 = b * x * z + a * y, e6 = b * x * z - a * y;
        const e5 = b * y * z - a * x, e7 = b * y * z + a * x;
        const q0 = u0 * e0 + u1 * e3 + u2 * e6, q1 = u0 * e1 + u1 * e4 + u2 * e7, q2 = u0 * e2 + u1 * e5 + u2 * e8;
        const q3 = u3 * e0 + u4 * e3 + u5 * e6, q4 = u3 * e1 + u4 * e4 + u5 * e7, q5 = u3 * e2 + u4 * e5 + u5 * e8;
        const q6 = u6 * e0 + u7 * e3 + u8 * e6, q7 = u6 * e1 + u7 * e4 + u8 * e7, q8 = u6 * e2 + u7 * e5 + u8 * e8;
        const o = 9 * i;
        for (let k = o; k < o + 9; k += 3) {
          const lx = local[k], ly = local[k + 1], lz = local[k + 2];
          let sx = pxx * lx + pxy * ly + pxz * lz, sy = pxy * lx + pyy * ly + pyz * lz, sz = pxz * lx + pyz * ly + pzz * lz;
          if (kept && k > o) { sx = lx; sy = ly; sz = lz; }  // tangents that do not stretch
          world[k] = q0 * sx + q1 * sy + q2 * sz;
          world[k + 1] = q3 * sx + q4 * sy + q5 * sz;
          world[k + 2] = q6 * sx + q7 * sy + q8 * sz;
        }
        world[o] += tx; world[o + 1] += ty; world[o + 2] += tz;
        if (turns) {
          q[o] = q0; q[o + 1] = q1; q[o + 2] = q2; q[o + 3] = q3; q[o + 4] = q4;
          q[o + 5] = q5; q[o + 6] = q6; q[o + 7] = q7; q[o + 8] = q8;
        }
      }
    }
  }

  /** Colours from the eye, in the light: c = max(0, f (1/2 + Y_0 base + sum Y_k(d) h_k)). */
  look(eye, shade) {
    const { world, colour, seen, face, coefficients: count, turns } = this, sh = this.harmonics, q = this.rotation;
    const b = new Float64Array(15);
    for (let i = 0; i < this.count; i++) {
      let red = colour[3 * i], green = colour[3 * i + 1], blue = colour[3 * i + 2];
      if (count > 0) {
        const o = 9 * i;
        let x = world[o] - eye[0], y = world[o + 1] - eye[1], z = world[o + 2] - eye[2];
        const g = 1 / Math.sqrt(Math.max(x * x + y * y + z * z, 1e-24));
        x *= g; y *= g; z *= g;
        if (turns) {
          const nx = x, ny = y, nz = z;
          x = q[o] * nx + q[o + 3] * ny + q[o + 6] * nz;
          y = q[o + 1] * nx + q[o + 4] * ny + q[o + 7] * nz;
          z = q[o + 2] * nx + q[o + 5] * ny + q[o + 8] * nz;
        }
        harmonics(x, y, z, count, b);
        for (let k = 0, from = 3 * count * i; k < count; k++, from += 3) {
          red += b[k] * sh[from];
          green += b[k] * sh[from + 1];
          blue += b[k] * sh[from + 2];
        }
      }
      const f = 3 * face[i];
      red *= shade[f]; green *= shade[f + 1]; blue *= shade[f + 2];
      seen[3 * i] = red > 0 ? red : 0;
      seen[3 * i + 1] = green > 0 ? green : 0;
      seen[3 * i + 2] = blue > 0 ? blue : 0;
    }
  }

  /** Indices of the surfels in front of the camera, the farthest first; `away` is the third row of [R | t]. */
  order(away) {
    const { world, opacity, sorter } = this, [x, y, z, t] = away;
    let visible = 0;
    for (let i = 0; i < this.count; i++) {
      const depth = x * world[9 * i] + y * world[9 * i + 1] + z * world[9 * i + 2] + t;
      if (!(depth > NEAR_PLANE) || !(depth < 1e9) || opacity[i] < OPACITY_THRESHOLD) continue;
      sorter.depth[visible] = depth;
      sorter.index[visible++] = i;
    }
    return sorter.farthestFirst(visible);
  }

  /** What the vertex shader reads of the surfels, in an order. */
  gather(order, target) {
    const { world, seen, log2Opacity } = this;
    for (let n = 0, to = 0; n < order.length; n++, to += FLOATS) {
      const i = order[n], from = 9 * i;
      for (let k = 0; k < 9; k++) target[to + k] = world[from + k];
      target[to + 9] = log2Opacity[i];
      target[to + 10] = seen[3 * i]; target[to + 11] = seen[3 * i + 1]; target[to + 12] = seen[3 * i + 2];
    }
  }
}

/** Stable radix sort by the bits of positive float32 numbers, eleven at a time. */
class DepthSorter {
  constructor(count) {
    this.depth = new Float32Array(count);
    this.key = new Uint32Array(this.depth.buffer);
    this.index = new Int32Array(count);
    this.otherKey = new Uint32Array(count);
    this.otherIndex = new Int32Array(count);
    this.places = new Uint32Array(2048);
  }

  farthestFirst(count) {
    let key = this.key, index = this.index, otherKey = this.otherKey, otherIndex = this.otherIndex;
    const { places } = this;
    let low = 0xffffffff, high = 0;
    for (let i = 0; i < count; i++) { if (key[i] < low) low = key[i]; if (key[i] > high) high = key[i]; }
    for (let shift = 0; shift < 32 && (high - low) >>> shift > 0; shift += 11) {
      places.fill(0);
      for (let i = 0; i < count; i++) places[((key[i] - low) >>> shift) & 2047]++;
      for (let d = 0, sum = 0; d < 2048; d++) { const n = places[d]; places[d] = sum; sum += n; }
      for (let i = 0; i < count; i++) {
        const to = places[((key[i] - low) >>> shift) & 2047]++;
        otherKey[to] = key[i];
        otherIndex[to] = index[i];
      }
      [key, otherKey, index, otherIndex] = [otherKey, key, otherIndex, index];
    }
    return index.subarray(0, count).reverse();
  }
}
