"use strict";
// Motion of the triangles that carry teeth or the body: `carigs.splat.rig.solid_motion`.

/** Triangles that move as one solid: one rotation, the nearest to the mean of theirs, and one translation. */
class Solid {
  constructor(rig, faces, points) {
    this.faces = Int32Array.from(faces);
    this.weight = new Float64Array(this.faces.length);
    this.faces.forEach((f, n) => {
      this.weight[n] = rig.valid[f] ? rig.lengths[3 * f] * rig.lengths[3 * f + 2] : 1e-30;
    });
    const total = this.weight.reduce((sum, area) => sum + area, 0);
    this.centres = new Float64Array(3 * this.faces.length);
    this.middle = new Float64Array(3);
    for (let n = 0; n < this.faces.length; n++) {
      this.weight[n] /= total;
      for (let c = 0; c < 3; c++) {
        for (let k = 0; k < 3; k++) this.centres[3 * n + c] += points[3 * rig.faces[3 * this.faces[n] + k] + c] / 3;
        this.middle[c] += this.weight[n] * this.centres[3 * n + c];
      }
    }
  }

  move(centre, rotation, stretch) {
    const { faces, weight, centres, middle } = this, mean = new Float64Array(9), now = new Float64Array(3);
    for (let n = 0; n < faces.length; n++) {
      for (let k = 0; k < 9; k++) mean[k] += weight[n] * rotation[9 * faces[n] + k];
      for (let c = 0; c < 3; c++) now[c] += weight[n] * centre[3 * faces[n] + c];
    }
    if (!polarRotation(mean)) return;
    for (let n = 0; n < faces.length; n++) {
      const f = faces[n];
      for (let c = 0; c < 3; c++) {
        centre[3 * f + c] = now[c];
        for (let k = 0; k < 3; k++) centre[3 * f + c] += mean[3 * c + k] * (centres[3 * n + k] - middle[k]);
      }
      rotation.set(mean, 9 * f);
      stretch.set([1, 0, 0, 1, 0, 1], 6 * f);
    }
  }
}
