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

  /** World positions of the vertices (3 v) of a timestep of the clip, given by its place. */
  pose(place, level, regionLevels) {
    const { header, rest } = this, frames = header.timesteps.length;
    const joints = new Float64Array(3 * header.joints);
    rest.set(this.template);
    const weights = lagrangeWeights(header.levels, level).map((weight, k) => [place + k * frames, k ? weight : 1]);
    this.add(this.clip, weights, joints);
    this.regions.forEach((region, i) => {
      if (!regionLevels[i]) return;
      const nodes = lagrangeWeights(header.regions[i].levels, regionLevels[i]);
      this.add(region, nodes.slice(1).map((weight, k) => [k, weight]), joints);
    });
    this.skin(place, joints);
    return this.posed;
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
  skin(place, joints) {
    const { header, rest, posed, weights } = this, count = header.joints;
    const transforms = this.jointTransforms(place, joints);
    const tx = this.translations[3 * place], ty = this.translations[3 * place + 1], tz = this.translations[3 * place + 2];
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
  jointTransforms(place, joints) {
    const count = this.header.joints, transforms = new Float64Array(12 * count);
    for (let j = 0; j < count; j++) {
      const parent = this.header.parents[j], own = this.rotations.subarray(9 * (place * count + j));
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
  lit(place, level, regionLevels) {
    const { light, shade, header } = this;
    if (!light) return shade;
    const last = header.lightLevels.length - 1, frames = header.timesteps.length, rank = light.basis.length;
    const share = Math.min(Math.max(level / header.lightLevels[last], 0), 1), below = Math.min(Math.floor(share * last), last - 1);
    const rows = [[place, 1 - share], [frames + place, share]];
    for (const [node, weight] of [[below, below + 1 - share * last], [below + 1, share * last - below]]) {
      if (node > 0 && node < last) rows.push([2 * frames + node - 1, weight]);
    }
    shade.set(light.mean);
    light.basis.forEach((basis, r) => {
      let factor = 0;
      for (const [row, weight] of rows) factor += weight * light.coefficients[row * rank + r];
      if (factor !== 0) for (let i = 0; i < shade.length; i++) shade[i] += factor * basis[i];
    });
    light.regions.forEach((change, i) => {
      const nodes = header.regions[i].levels, factor = regionLevels[i] / nodes[nodes.length - 1];
      if (factor) for (let j = 0; j < shade.length; j++) shade[j] += Math.min(Math.max(factor, 0), 1) * change[j];
    });
    for (let i = 0; i < shade.length; i++) if (shade[i] < 0) shade[i] = 0;
    return shade;
  }
}
