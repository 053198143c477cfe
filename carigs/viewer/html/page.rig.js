"use strict";
// The motion of every triangle from the canonical to the posed mesh: `carigs.splat.rig.rig.face_motion`.
//
// J = E(posed) E(canonical)^-1 with E = [edge 01, edge 02, normal sqrt(2 area)] maps the plane of the triangle to its
// posed plane and normal to normal. In the frames [edge, towards the third corner, normal] of both triangles it is a
// 2 x 2 matrix and a number, and its polar decomposition J = U P has a closed form.

const DEGENERATE = 1e-6;

/** Triangle across each edge (01, 12, 20); the own index where there is none, or more than one. */
function edgeNeighbours(faces, vertices) {
  const count = faces.length / 3, seen = new Map(), across = new Int32Array(3 * count);
  for (let slot = 0; slot < 3 * count; slot++) {
    const f = Math.floor(slot / 3), a = faces[slot], b = faces[3 * f + ((slot + 1) % 3)];
    const key = Math.min(a, b) * vertices + Math.max(a, b);
    across[slot] = f;
    if (seen.has(key)) seen.get(key).push(slot);
    else seen.set(key, [slot]);
  }
  for (const slots of seen.values()) {
    if (slots.length !== 2) continue;
    across[slots[0]] = Math.floor(slots[1] / 3);
    across[slots[1]] = Math.floor(slots[0] / 3);
  }
  return across;
}

/** Frame [x, y, z] of a triangle by columns (9), its lengths [base, third corner's x and y], and whether it has one. */
function triangleFrame(points, faces, f, frame, lengths) {
  const i = 3 * faces[3 * f], j = 3 * faces[3 * f + 1], k = 3 * faces[3 * f + 2];
  const ax = points[j] - points[i], ay = points[j + 1] - points[i + 1], az = points[j + 2] - points[i + 2];
  const bx = points[k] - points[i], by = points[k + 1] - points[i + 1], bz = points[k + 2] - points[i + 2];
  const cx = ay * bz - az * by, cy = az * bx - ax * bz, cz = ax * by - ay * bx;
  const aa = ax * ax + ay * ay + az * az, bb = bx * bx + by * by + bz * bz;
  const dd = (bx - ax) * (bx - ax) + (by - ay) * (by - ay) + (bz - az) * (bz - az);
  const area = Math.sqrt(cx * cx + cy * cy + cz * cz), base = Math.sqrt(aa);
  if (!(area > DEGENERATE * Math.max(aa, bb, dd))) {
    lengths[0] = base;
    return false;
  }
  const xx = ax / base, xy = ay / base, xz = az / base, zx = cx / area, zy = cy / area, zz = cz / area;
  frame[0] = xx; frame[1] = xy; frame[2] = xz;
  frame[3] = zy * xz - zz * xy; frame[4] = zz * xx - zx * xz; frame[5] = zx * xy - zy * xx;
  frame[6] = zx; frame[7] = zy; frame[8] = zz;
  lengths[0] = base;
  lengths[1] = bx * xx + by * xy + bz * xz;
  lengths[2] = bx * frame[3] + by * frame[4] + bz * frame[5];
  return true;
}

class Rig {
  constructor(data, header, template) {
    const faces = data.rows("faces"), count = header.faces;
    this.faces = Int32Array.from(faces);
    this.count = count;
    this.similarity = header.skinning === "similarity";
    this.neighbours = edgeNeighbours(this.faces, header.vertices);
    this.frames = new Float64Array(9 * count);  // columns x, y, z of the canonical triangles
    this.lengths = new Float64Array(3 * count);
    this.valid = new Uint8Array(count);
    this.scale = new Float64Array(count);
    const points = Float64Array.from(template);
    for (let f = 0; f < count; f++) {
      const frame = this.frames.subarray(9 * f, 9 * f + 9), lengths = this.lengths.subarray(3 * f, 3 * f + 3);
      this.valid[f] = triangleFrame(points, this.faces, f, frame, lengths) ? 1 : 0;
      if (!this.valid[f]) frame.set([1, 0, 0, 0, 1, 0, 0, 0, 1]);
      this.scale[f] = (lengths[0] + (this.valid[f] ? lengths[2] : 0)) / 2;
    }
    this.pairs = [];  // neighbours, each pair once: triangle, its side, the other triangle, its side
    for (let slot = 0; slot < 3 * count; slot++) {
      const f = Math.floor(slot / 3), g = this.neighbours[slot];
      if (g <= f) continue;
      for (let side = 0; side < 3; side++) if (this.neighbours[3 * g + side] === f) this.pairs.push(slot, 3 * g + side);
    }
    this.pairs = Int32Array.from(this.pairs);
    this.centre = new Float64Array(3 * count);
    this.rotation = new Float64Array(9 * count);  // row by row
    this.stretch = new Float64Array(6 * count);  // xx, xy, xz, yy, yz, zz
    this.turn = new Float64Array(9 * count);  // rotation vectors log(U^T U_neighbour), one for each side
    this.kept = new Uint8Array(count);  // triangles whose surfels keep their size: `Rig.keeps_size`
    if (data.has("kept")) for (const f of data.rows("kept")) this.kept[f] = 1;
    this.hair = data.has("hair") ? new Hair(this, data, header, points) : null;
    const solids = ["upper_jaw", "lower_jaw", "body"].filter((name) => data.has(name));
    this.solids = solids.map((name) => new Solid(this, data.rows(name), points));
  }

  /** Centres, rotations and stretches of all triangles, and the relative rotations of neighbours. */
  move(posed) {
    const missing = this.polar(posed);
    if (missing.length) this.followNeighbours(missing);
    if (this.hair) this.hair.smooth(this.rotation, this.stretch);
    for (const solid of this.solids) solid.move(this.centre, this.rotation, this.stretch);
    if (this.similarity) this.makeSimilar();
    this.relativeRotations();
  }

  polar(posed) {
    const { faces, count, frames, lengths, valid, centre, rotation, stretch } = this;
    const now = new Float64Array(9), length = new Float64Array(3), missing = [];
    for (let f = 0; f < count; f++) {
      const i = 3 * faces[3 * f], j = 3 * faces[3 * f + 1], k = 3 * faces[3 * f + 2];
      for (let c = 0; c < 3; c++) centre[3 * f + c] = (posed[i + c] + posed[j + c] + posed[k + c]) / 3;
      if (!triangleFrame(posed, faces, f, now, length) || !valid[f]) {
        missing.push(f);
        rotation.set([1, 0, 0, 0, 1, 0, 0, 0, 1], 9 * f);
        stretch.set([1, 0, 0, 1, 0, 1], 6 * f);
        continue;
      }
      const base = lengths[3 * f], x0 = lengths[3 * f + 1], y0 = lengths[3 * f + 2];
      const p = length[0] / base, q = (length[1] - p * x0) / y0, r = length[2] / y0;
      const s = Math.sqrt(p * r);  // square root of the ratio of the areas
      const h = 1 / Math.hypot(p + r, q), cos = (p + r) * h, sin = -q * h;
      const sxx = cos * p, sxy = cos * q + sin * r, syy = cos * r - sin * q;
      const a = 9 * f, o = 6 * f;
      const xx = frames[a], xy = frames[a + 1], xz = frames[a + 2];
      const yx = frames[a + 3], yy = frames[a + 4], yz = frames[a + 5];
      const zx = frames[a + 6], zy = frames[a + 7], zz = frames[a + 8];
      for (let c = 0; c < 3; c++) {
        const u = cos * now[c] + sin * now[3 + c], v = cos * now[3 + c] - sin * now[c], w = now[6 + c];
        rotation[a + 3 * c] = u * xx + v * yx + w * zx;
        rotation[a + 3 * c + 1] = u * xy + v * yy + w * zy;
        rotation[a + 3 * c + 2] = u * xz + v * yz + w * zz;
      }
      stretch[o] = sxx * xx * xx + 2 * sxy * xx * yx + syy * yx * yx + s * zx * zx;
      stretch[o + 1] = sxx * xx * xy + sxy * (xx * yy + yx * xy) + syy * yx * yy + s * zx * zy;
      stretch[o + 2] = sxx * xx * xz + sxy * (xx * yz + yx * xz) + syy * yx * yz + s * zx * zz;
      stretch[o + 3] = sxx * xy * xy + 2 * sxy * xy * yy + syy * yy * yy + s * zy * zy;
      stretch[o + 4] = sxx * xy * xz + sxy * (xy * yz + yy * xz) + syy * yy * yz + s * zy * zz;
      stretch[o + 5] = sxx * xz * xz + 2 * sxy * xz * yz + syy * yz * yz + s * zz * zz;
    }
    return missing;
  }

  /** Degenerate triangles take the mean motion of valid neighbours, ring by ring; the rest keeps the identity. */
  followNeighbours(missing) {
    const unknown = new Set(missing);
    for (;;) {
      const ring = [];
      for (const f of unknown) {
        const known = [0, 1, 2].map((side) => this.neighbours[3 * f + side]).filter((g) => !unknown.has(g));
        if (known.length) ring.push([f, known]);
      }
      if (!ring.length) return;
      for (const [f, known] of ring) {
        const mean = (array, size) => Array.from({ length: size }, (_, i) =>
          known.reduce((sum, g) => sum + array[size * g + i], 0) / known.length);
        const rotation = mean(this.rotation, 9);
        if (polarRotation(rotation)) this.rotation.set(rotation, 9 * f);
        this.stretch.set(mean(this.stretch, 6), 6 * f);
      }
      for (const [f] of ring) unknown.delete(f);
    }
  }

  /** The similarity between the frames of the triangles, without stretch: `similarity_motion`. */
  makeSimilar() {
    const corners = new Float64Array(9), frame = new Float64Array(9), length = new Float64Array(3);
    for (let f = 0; f < this.count; f++) {
      let ratio = 1;
      if (this.valid[f]) {
        const base = this.lengths[3 * f], x0 = this.lengths[3 * f + 1], y0 = this.lengths[3 * f + 2];
        const k = this.frames.subarray(9 * f, 9 * f + 9);
        for (let c = 0; c < 3; c++) { corners[3 + c] = base * k[c]; corners[6 + c] = x0 * k[c] + y0 * k[3 + c]; }
        const moved = new Float64Array(9);
        for (let v = 1; v < 3; v++) moved.set(this.jacobianTimes(f, corners.subarray(3 * v, 3 * v + 3)), 3 * v);
        if (triangleFrame(moved, [0, 1, 2], 0, frame, length)) {
          ratio = (length[0] + length[2]) / (base + y0);
          for (let r = 0; r < 3; r++) for (let c = 0; c < 3; c++) {
            this.rotation[9 * f + 3 * r + c] = frame[r] * k[c] + frame[3 + r] * k[3 + c] + frame[6 + r] * k[6 + c];
          }
        }
      }
      this.stretch.set([ratio, 0, 0, ratio, 0, ratio], 6 * f);
    }
  }

  jacobianTimes(f, x) {
    const p = this.stretch.subarray(6 * f, 6 * f + 6), u = this.rotation.subarray(9 * f, 9 * f + 9);
    const a = p[0] * x[0] + p[1] * x[1] + p[2] * x[2], b = p[1] * x[0] + p[3] * x[1] + p[4] * x[2];
    const c = p[2] * x[0] + p[4] * x[1] + p[5] * x[2];
    return [0, 3, 6].map((row) => u[row] * a + u[row + 1] * b + u[row + 2] * c);
  }

  /** log(U^T U_i) for every side; that of the neighbour towards this triangle is the negative. */
  relativeRotations() {
    const { pairs, rotation, turn } = this;
    for (let i = 0; i < pairs.length; i += 2) {
      const here = 3 * pairs[i], there = 3 * pairs[i + 1];
      const a = 9 * Math.floor(pairs[i] / 3), b = 9 * Math.floor(pairs[i + 1] / 3);
      const a0 = rotation[a], a1 = rotation[a + 1], a2 = rotation[a + 2], a3 = rotation[a + 3], a4 = rotation[a + 4];
      const a5 = rotation[a + 5], a6 = rotation[a + 6], a7 = rotation[a + 7], a8 = rotation[a + 8];
      const b0 = rotation[b], b1 = rotation[b + 1], b2 = rotation[b + 2], b3 = rotation[b + 3], b4 = rotation[b + 4];
      const b5 = rotation[b + 5], b6 = rotation[b + 6], b7 = rotation[b + 7], b8 = rotation[b + 8];
      const r0 = a0 * b0 + a3 * b3 + a6 * b6, r4 = a1 * b1 + a4 * b4 + a7 * b7, r8 = a2 * b2 + a5 * b5 + a8 * b8;
      const r1 = a0 * b1 + a3 * b4 + a6 * b7, r3 = a1 * b0 + a4 * b3 + a7 * b6;
      const r2 = a0 * b2 + a3 * b5 + a6 * b8, r6 = a2 * b0 + a5 * b3 + a8 * b6;
      const r5 = a1 * b2 + a4 * b5 + a7 * b8, r7 = a2 * b1 + a5 * b4 + a8 * b7;
      // Through the quaternion: of four times the squares of w, x, y, z the largest divides.
      const ww = 1 + r0 + r4 + r8, xx = 1 + r0 - r4 - r8, yy = 1 - r0 + r4 - r8, zz = 1 - r0 - r4 + r8;
      let w = ww, x = r7 - r5, y = r2 - r6, z = r3 - r1;
      if (ww < xx || ww < yy || ww < zz) {
        if (xx >= yy && xx >= zz) { w = r7 - r5; x = xx; y = r3 + r1; z = r2 + r6; }
        else if (yy >= zz) { w = r2 - r6; x = r3 + r1; y = yy; z = r7 + r5; }
        else { w = r3 - r1; x = r2 + r6; y = r7 + r5; z = zz; }
        if (w < 0) { w = -w; x = -x; y = -y; z = -z; }
      }
      const length = Math.sqrt(x * x + y * y + z * z), tangent = length / w;
      // atan(t) / t by its series for small angles
      const factor = tangent < 0.05
        ? (2 / w) * (1 - tangent * tangent * (1 / 3 - tangent * tangent * (1 / 5 - (tangent * tangent) / 7)))
        : (2 * Math.atan2(length, w)) / length;
      turn[here] = factor * x; turn[here + 1] = factor * y; turn[here + 2] = factor * z;
      turn[there] = -factor * x; turn[there + 1] = -factor * y; turn[there + 2] = -factor * z;
    }
  }
}
