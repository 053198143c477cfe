"use strict";
// Smooth motion of the triangles that carry hair: `carigs.splat.rig.smooth_motion`.

const HAIR_RADIUS = 0.03;
const NEGLIGIBLE_SHARE = 1e-9, NEGLIGIBLE_WEIGHT = 1e-5;  // of a triangle in an anchor's mean, of an anchor in a triangle's

/**
 * The nearest rotation to a matrix m with a positive determinant, by Newton's iteration (Higham 1986), in place; false if
 * the determinant is not positive.
 */
function polarRotation(m) {
  let a = m[0], b = m[1], c = m[2], d = m[3], e = m[4], f = m[5], g = m[6], h = m[7], i = m[8];
  for (let step = 0; step < 30; step++) {
    const ca = e * i - f * h, cb = f * g - d * i, cc = d * h - e * g;
    const cd = c * h - b * i, ce = a * i - c * g, cf = b * g - a * h;
    const cg = b * f - c * e, ch = c * d - a * f, ci = a * e - b * d;
    const det = a * ca + b * cb + c * cc;
    if (!(det > 1e-30)) return false;
    const own = a * a + b * b + c * c + d * d + e * e + f * f + g * g + h * h + i * i;
    const other = ca * ca + cb * cb + cc * cc + cd * cd + ce * ce + cf * cf + cg * cg + ch * ch + ci * ci;
    const scale = Math.sqrt(Math.sqrt(other / own) / det), k = 0.5 * scale, n = 0.5 / (scale * det);
    const oldA = a, oldE = e, oldI = i, oldB = b, oldF = f, oldG = g;
    a = k * a + n * ca; b = k * b + n * cb; c = k * c + n * cc;
    d = k * d + n * cd; e = k * e + n * ce; f = k * f + n * cf;
    g = k * g + n * cg; h = k * h + n * ch; i = k * i + n * ci;
    const change = Math.abs(a - oldA) + Math.abs(e - oldE) + Math.abs(i - oldI)
      + Math.abs(b - oldB) + Math.abs(f - oldF) + Math.abs(g - oldG);
    if (change < 1e-7) break;  // convergence is quadratic
  }
  m[0] = a; m[1] = b; m[2] = c; m[3] = d; m[4] = e; m[5] = f; m[6] = g; m[7] = h; m[8] = i;
  return true;
}

/** Rotations of the triangles that carry hair, averaged over their neighbourhood: `carigs.splat.rig.smooth_motion`. */
class Hair {
  constructor(rig, data, header, points) {
    this.faces = Int32Array.from(data.rows("hair"));
    const anchors = Int32Array.from(data.rows("anchors")), count = this.faces.length, a = anchors.length;
    this.grows = header.hairGrows;
    this.share = Float64Array.from(data.rows("hair_share"));
    const centres = new Float64Array(3 * count), area = new Float64Array(count);
    for (let n = 0; n < count; n++) {
      const f = this.faces[n];
      for (let c = 0; c < 3; c++) {
        for (let k = 0; k < 3; k++) centres[3 * n + c] += points[3 * rig.faces[3 * f + k] + c] / 3;
      }
      area[n] = rig.valid[f] ? rig.lengths[3 * f] * rig.lengths[3 * f + 2] : 0;
    }
    // Row by row, from each triangle to the anchors (gather) and back (scatter).
    const gather = new Float64Array(count * a), scatter = new Float64Array(count * a), along = new Float64Array(a);
    for (let n = 0; n < count; n++) {
      let across = 0;
      for (let m = 0; m < a; m++) {
        let squared = 0;
        for (let c = 0; c < 3; c++) squared += (centres[3 * n + c] - centres[3 * anchors[m] + c]) ** 2;
        const weight = Math.exp((-0.5 * squared) / HAIR_RADIUS ** 2) + 1e-12;
        scatter[n * a + m] = weight;
        gather[n * a + m] = weight * area[n];
        across += weight;
        along[m] += weight * area[n];
      }
      for (let m = 0; m < a; m++) scatter[n * a + m] /= across;
    }
    for (let n = 0; n < count; n++) for (let m = 0; m < a; m++) gather[n * a + m] /= Math.max(along[m], 1e-30);
    Object.assign(this, { gather, scatter, anchors: a });
  }

  smooth(rotation, stretch) {
    const { faces, share, gather, scatter, anchors, grows } = this;
    const means = new Float64Array(10 * anchors), mean = new Float64Array(9);
    for (let n = 0; n < faces.length; n++) {
      const u = 9 * faces[n], volume = grows ? Math.log(Math.max(determinant(stretch, 6 * faces[n]), 1e-9)) : 0;
      const a = rotation[u], b = rotation[u + 1], c = rotation[u + 2], d = rotation[u + 3], e = rotation[u + 4];
      const f = rotation[u + 5], g = rotation[u + 6], h = rotation[u + 7], i = rotation[u + 8];
      for (let m = 0, to = 0; m < anchors; m++, to += 10) {
        const w = gather[n * anchors + m];
        if (w < NEGLIGIBLE_SHARE) continue;
        means[to] += w * a; means[to + 1] += w * b; means[to + 2] += w * c; means[to + 3] += w * d; means[to + 4] += w * e;
        means[to + 5] += w * f; means[to + 6] += w * g; means[to + 7] += w * h; means[to + 8] += w * i;
        means[to + 9] += w * volume;
      }
    }
    for (let n = 0; n < faces.length; n++) {
      let a = 0, b = 0, c = 0, d = 0, e = 0, f = 0, g = 0, h = 0, i = 0, volume = 0;
      for (let m = 0, from = 0; m < anchors; m++, from += 10) {
        const w = scatter[n * anchors + m];
        if (w < NEGLIGIBLE_WEIGHT) continue;
        a += w * means[from]; b += w * means[from + 1]; c += w * means[from + 2]; d += w * means[from + 3];
        e += w * means[from + 4]; f += w * means[from + 5]; g += w * means[from + 6]; h += w * means[from + 7];
        i += w * means[from + 8]; volume += w * means[from + 9];
      }
      mean[0] = a; mean[1] = b; mean[2] = c; mean[3] = d; mean[4] = e; mean[5] = f; mean[6] = g; mean[7] = h; mean[8] = i;
      const u = 9 * faces[n], p = 6 * faces[n], factor = grows ? Math.exp(volume / 3) : 1;
      for (let k = 0; k < 9; k++) mean[k] = rotation[u + k] + share[n] * (mean[k] - rotation[u + k]);
      if (polarRotation(mean)) for (let k = 0; k < 9; k++) rotation[u + k] = mean[k];
      stretch[p] = stretch[p + 3] = stretch[p + 5] = factor;
      stretch[p + 1] = stretch[p + 2] = stretch[p + 4] = 0;
    }
  }
}

/** Determinant of a symmetric matrix xx, xy, xz, yy, yz, zz. */
function determinant(p, at) {
  const xx = p[at], xy = p[at + 1], xz = p[at + 2], yy = p[at + 3], yz = p[at + 4], zz = p[at + 5];
  return xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz);
}
