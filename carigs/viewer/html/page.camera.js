"use strict";
// Cameras: OpenCV axes (x right, y down, z forward), metres, pixels; `carigs.library.orbit_cameras`.

const FIELD_OF_VIEW = 22, MARGIN = 1.35;  // degrees from top to bottom; height of the image over that of the head

/** The camera of an orbit {azimuth, elevation (degrees), zoom} around a head {middle, extent} in a window. */
function orbitCamera(orbit, head, width, height) {
  const tangent = Math.tan((FIELD_OF_VIEW * Math.PI) / 360), focal = (0.5 * height) / tangent;
  const distance = (0.5 * MARGIN * head.extent) / (tangent * Math.min(1, width / height)) / orbit.zoom;
  const azimuth = (orbit.azimuth * Math.PI) / 180, elevation = (orbit.elevation * Math.PI) / 180;
  const out = Math.cos(elevation), up = Math.sin(elevation);
  const towards = [out * Math.sin(azimuth), up, out * Math.cos(azimuth)];
  const eye = towards.map((component, c) => head.middle[c] + distance * component);
  const forward = towards.map((component) => -component);
  const right = unit(cross(forward, [0, 1, 0])), down = cross(forward, right);
  const rows = [right, down, forward].flatMap((axis) => [...axis, -dot(axis, eye)]);
  return { rows, fx: focal, fy: focal, cx: width / 2, cy: height / 2, width, height };
}

/** The same view with other numbers of pixels. */
function resized(camera, width, height) {
  const x = width / camera.width, y = height / camera.height;
  return { ...camera, fx: camera.fx * x, cx: camera.cx * x, fy: camera.fy * y, cy: camera.cy * y, width, height };
}

/** Centre of a camera in the world: -R^T t. */
function eyeOf({ rows: r }) {
  return [0, 1, 2].map((c) => -(r[c] * r[3] + r[4 + c] * r[7] + r[8 + c] * r[11]));
}

function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

function unit(a) {
  const length = Math.sqrt(dot(a, a));
  return a.map((component) => component / length);
}
