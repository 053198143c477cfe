"use strict";
// The posed mesh and the light on it: `carigs.head.posing.pose` from the sums of `head_arrays.py`.

/** Lagrange weights of the nodes at a level, by the barycentric formula (Berrut and Trefethen 2004, eq. 4.2). */
function lagrangeWeights(nodes, level) {
  const at = nodes.indexOf(level);
  if (at >= 0) return nodes.map((_, i) => (i === at ? 1 : 0));
  const terms = nodes.map((node, i) => {
    let product = level - node;
    nodes.forEach((other, j) => { if (j !== i) product *= node - other; });
    return 1 / product;
  });
  const total = terms.reduce((sum, term) => sum + term, 0);
  return terms.map((term) => term / total);
}

class Head {
  constructor(data, header) {
    this.header = header;
    this.template = data.rows("template");
    this.weights = data.rows("weights");
    this.rotations = data.rows("rotations");
    this.translations = data.rows("translations");
    this.clip = this.sums(data, "clip");
    this.regions = header.regions.map((_, i) => this.sums(data, `region${i}`));
    this.light = header.lightLevels.length > 0 && {
      mean: data.rows("light_mean"),
      basis: data.columns("light_basis"),
      coefficients: data.rows("light_coefficients"),
      regions: header.regions.map((_, i) => data.rows(`light_region${i}`)),
    };
    this.columns = data.columns("column_basis");
    this.columnJoints = data.rows("column_joints");
    this.changes = this.sums(data, "change");
    this.clips = header.clips.map((clip, i) => ({
      coefficients: data.rows(`clip${i}_coefficients`),
      vectors: data.rows(`clip${i}_vectors`),
      translations: data.rows(`clip${i}_translations`),
      light: this.light && data.rows(`clip${i}_light`),
      lit: this.light && data.rows(`clip${i}_light_frames`),
    }));
    this.rest = new Float64Array(this.template.length);
    this.posed = new Float64Array(this.template.length);
    this.shade = new Float32Array(3 * header.faces).fill(1);
    this.normaliseWeights();
  }

  sums(data, name) {
    return {
      basis: data.columns(`${name}_basis`),
      coefficients: data.rows(`${name}_coefficients`),
      joints: data.rows(`${name}_joints`),
    };
  }

  /** Weights were rounded: they shall sum to 1. */
  normaliseWeights() {
    const { weights } = this, count = this.header.joints;
    for (let v = 0; v < weights.length; v += count) {
      let sum = 0;
      for (let j = 0; j < count; j++) sum += weights[v + j];
      if (sum > 0) for (let j = 0; j < count; j++) weights[v + j] /= sum;
    }
  }

  /**
   * World positions of the vertices (3 v) of a request {place, clip, frame, amounts, turns, level, regions}: of a
   * captured timestep, given by its place, or of a frame of a clip (null: none). Amounts of columns and turns of joints,
   * as rotation vectors, are added.
   */
  pose({ place, clip, frame, amounts, turns, level, regions: regionLevels }) {
    const { header, rest } = this, frames = header.timesteps.length, base = clip === null ? place : 0;
    const joints = new Float64Array(3 * header.joints), nodes = lagrangeWeights(header.levels, level);
    rest.set(this.template);
    this.add(this.clip, nodes.map((weight, k) => [base + k * frames, k ? weight : 1]), joints);
    const rotations = this.turned(base, clip, frame, turns);
    this.addColumns(this.amountsOf(base, clip, frame, amounts, rotations), nodes, joints);
    this.regions.forEach((region, i) => {
      if (!regionLevels[i]) return;
      const nodes = lagrangeWeights(header.regions[i].levels, regionLevels[i]);
      this.add(region, nodes.slice(1).map((weight, k) => [k, weight]), joints);
    });
    const source = clip === null ? this.translations : this.clips[clip].translations, at = 3 * (clip === null ? place : frame);
    this.skin(rotations, source.subarray(at, at + 3), joints);
    return this.posed;
  }

  /** Rotations of the joints relative to their parents, row by row. */
  turned(place, clip, frame, turns) {
    const count = this.header.joints, rotations = new Float64Array(9 * count);
    rotations.set(this.rotations.subarray(9 * place * count, 9 * (place + 1) * count));
    for (let j = 0; j < count; j++) {
      if (clip !== null) rotations.set(rotationMatrix(this.clips[clip].vectors.subarray(3 * (frame * count + j))), 9 * j);
      const turn = turns.slice(3 * j, 3 * j + 3);
      if (turn.some((angle) => angle)) rotations.set(product(rotations.slice(9 * j, 9 * j + 9), rotationMatrix(turn)), 9 * j);
    }
    return rotations;
  }

  /** Amounts of the columns: differences of expressions, and of the entries of R - I of the last joints. */
  amountsOf(place, clip, frame, amounts, rotations) {
    const { header } = this, { columns, corrected } = header, expressions = columns - corrected, result = new Float64Array(columns);
    for (let e = 0; e < expressions; e++) {
      result[e] = (amounts[e] || 0) + (clip === null ? 0 : this.clips[clip].coefficients[frame * expressions + e]);
    }
    const first = 9 * header.joints - corrected, known = this.rotations.subarray(9 * place * header.joints);
    for (let i = 0; i < corrected; i++) result[expressions + i] = rotations[first + i] - known[first + i];
    return result;
  }

  /** Add columns and their changes with the level. */
  addColumns(amounts, nodes, joints) {
    const { rest, columns, columnJoints } = this, rows = [];
    amounts.forEach((amount, e) => {
      if (Math.abs(amount) < 1e-7) return;
      const column = columns[e];
      for (let i = 0; i < rest.length; i++) rest[i] += amount * column[i];
      for (let i = 0; i < joints.length; i++) joints[i] += amount * columnJoints[e * joints.length + i];
      for (let k = 1; k < nodes.length; k++) if (nodes[k]) rows.push([(k - 1) * amounts.length + e, amount * nodes[k]]);
    });
    if (rows.length) this.add(this.changes, rows, joints);
  }

  /** Add rows of a sum, [row, weight], to the vertices at rest and to the joints. */
  add(sum, rows, joints) {
    const { rest } = this, rank = sum.basis.length;
    for (const [row, weight] of rows) {
      for (let i = 0; i < joints.length; i++) joints[i] += weight * sum.joints[row * joints.length + i];
    }
    for (let r = 0; r < rank; r++) {
      let factor = 0;
      for (const [row, weight] of rows) factor += weight * sum.coefficients[row * rank + r];
      if (factor === 0) continue;
      const basis = sum.basis[r];
      for (let i = 0; i < rest.length; i++) rest[i] += factor * basis[i];
    }
  }

  /** Linear blend skinning (Li et al. 2017, equations 1 to 5). */
  skin(rotations, [tx, ty, tz], joints) {
    const { header, rest, posed, weights } = this, count = header.joints;
    const transforms = this.jointTransforms(rotations, joints);
    const m = new Float64Array(12);
    for (let v = 0; v < header.vertices; v++) {
      m.fill(0);
      for (let j = 0; j < count; j++) {
        const weight = weights[v * count + j];
        if (weight === 0) continue;
        for (let i = 0; i < 12; i++) m[i] += weight * transforms[12 * j + i];
      }
      const x = rest[3 * v], y = rest[3 * v + 1], z = rest[3 * v + 2];
      posed[3 * v] = m[0] * x + m[1] * y + m[2] * z + m[3] + tx;
      posed[3 * v + 1] = m[4] * x + m[5] * y + m[6] * z + m[7] + ty;
      posed[3 * v + 2] = m[8] * x + m[9] * y + m[10] * z + m[11] + tz;
    }
  }

  /** Rigid transforms world_from_rest [R | t] of the joints, row by row, along the kinematic chain. */
  jointTransforms(rotations, joints) {
    const count = this.header.joints, transforms = new Float64Array(12 * count);
    for (let j = 0; j < count; j++) {
      const parent = this.header.parents[j], own = rotations.subarray(9 * j);
      const at = [joints[3 * j], joints[3 * j + 1], joints[3 * j + 2]];
      for (let row = 0; row < 3; row++) {
        const to = 12 * j + 4 * row;
        let position = at[row];
        if (parent < 0) {
          for (let c = 0; c < 3; c++) transforms[to + c] = own[3 * row + c];
        } else {
          const from = 12 * parent + 4 * row;
          position = transforms[from + 3];
          for (let k = 0; k < 3; k++) {
            position += transforms[from + k] * at[k];
            for (let c = 0; c < 3; c++) transforms[to + c] += transforms[from + k] * own[3 * k + c];
          }
        }
        transforms[to + 3] = position - transforms[to] * at[0] - transforms[to + 1] * at[1] - transforms[to + 2] * at[2];
      }
    }
    return transforms;
  }

  /** Factors on the colours of the triangles (3 f): the sums of `light_arrays.py`. */
  lit({ place, clip, frame, level, regions: regionLevels }) {
    const { light, shade, header } = this;
    if (!light) return shade;
    const last = header.lightLevels.length - 1, frames = header.timesteps.length, rank = light.basis.length;
    const share = Math.min(Math.max(level / header.lightLevels[last], 0), 1), below = Math.min(Math.floor(share * last), last - 1);
    const captured = light.coefficients, rows = clip === null
      ? [[place, 1 - share, captured], [frames + place, share, captured]] : this.litClip(this.clips[clip], frame, share);
    for (const [node, weight] of [[below, below + 1 - share * last], [below + 1, share * last - below]]) {
      if (node > 0 && node < last) rows.push([2 * frames + node - 1, weight, captured]);
    }
    shade.set(light.mean);
    light.basis.forEach((basis, r) => {
      let factor = 0;
      for (const [row, weight, coefficients] of rows) factor += weight * coefficients[row * rank + r];
      if (factor !== 0) for (let i = 0; i < shade.length; i++) shade[i] += factor * basis[i];
    });
    light.regions.forEach((change, i) => {
      const nodes = header.regions[i].levels, factor = regionLevels[i] / nodes[nodes.length - 1];
      if (factor) for (let j = 0; j < shade.length; j++) shade[j] += Math.min(Math.max(factor, 0), 1) * change[j];
    });
    for (let i = 0; i < shade.length; i++) if (shade[i] < 0) shade[i] = 0;
    return shade;
  }

  /** Rows of the light of a clip around a frame, [row, weight, coefficients]. */
  litClip({ light, lit }, frame, share) {
    let next = 0;
    while (next < lit.length - 1 && lit[next] < frame) next++;
    const last = Math.max(next - 1, 0), width = lit[next] - lit[last], between = width > 0 ? (frame - lit[last]) / width : 0;
    return [[last, 1 - between], [next, between]].flatMap(([key, weight]) => [
      [key, weight * (1 - share), light], [lit.length + key, weight * share, light],
    ]);
  }
}

/** Matrix of a rotation vector, row by row (Rodrigues). */
function rotationMatrix([x, y, z]) {
  const angle = Math.hypot(x, y, z), a = angle < 1e-6 ? 1 : Math.sin(angle) / angle;
  const b = angle < 1e-4 ? 0.5 : (1 - Math.cos(angle)) / (angle * angle), c = angle < 1e-6 ? 1 - 0.5 * angle * angle : Math.cos(angle);
  return [
    c + b * x * x, b * x * y - a * z, b * x * z + a * y,
    b * x * y + a * z, c + b * y * y, b * y * z - a * x,
    b * x * z - a * y, b * y * z + a * x, c + b * z * z,
  ];
}

/** Product of two matrices, row by row. */
function product(a, b) {
  return Array.from({ length: 9 }, (_, i) => {
    const row = 3 * Math.floor(i / 3), column = i % 3;
    return a[row] * b[column] + a[row + 1] * b[column + 3] + a[row + 2] * b[column + 6];
  });
}
