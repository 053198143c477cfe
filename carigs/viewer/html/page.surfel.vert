#version 300 es
// A quadrilateral around the pixels of a surfel where alpha is at least 1/255: carigs/splat/rasterizer/projection.py.
precision highp float;
precision highp int;
precision highp sampler2D;

uniform sampler2D surfels;  // four texels each: centre, tangents, log2 of the opacity, colour
uniform vec4 cameraFromWorld[3];  // rows
uniform vec2 focal, middle, size;  // pixels

flat out vec4 homography;  // U0, U1, V0, V1
flat out vec4 denominator;  // det, a3, b3, log2 of the opacity
flat out vec2 place;  // projected centre in pixels
flat out vec3 colour;

const float LN2 = 0.6931471805599453, LOG2_255 = 7.994353436858858;
const float CAMERA_PLANE_MARGIN = -1e-4, NEAR_PLANE = 0.01, MARGIN = 0.01;

vec3 turned(vec3 v) {
  return vec3(dot(cameraFromWorld[0].xyz, v), dot(cameraFromWorld[1].xyz, v), dot(cameraFromWorld[2].xyz, v));
}

// Range of offsets along one axis.
vec2 extent(float a, float b, float p, float q, float rho2) {
  float e = rho2 * (p * p + q * q) - 1.0, mean = rho2 * (a * p + b * q) / e;
  float half_ = sqrt(max(mean * mean - rho2 * (a * a + b * b) / e, 0.0));
  return vec2(mean - half_, mean + half_);
}

void main() {
  int surfel = gl_VertexID >> 2, corner = gl_VertexID & 3;
  ivec2 at = ivec2((surfel & 511) << 2, surfel >> 9);
  vec4 a = texelFetch(surfels, at, 0), b = texelFetch(surfels, at + ivec2(1, 0), 0);
  vec4 c = texelFetch(surfels, at + ivec2(2, 0), 0), d = texelFetch(surfels, at + ivec2(3, 0), 0);
  float log2Opacity = c.y;
  colour = vec3(c.zw, d.x);
  vec3 m = turned(a.xyz) + vec3(cameraFromWorld[0].w, cameraFromWorld[1].w, cameraFromWorld[2].w);
  vec3 u = turned(vec3(a.w, b.xy)), v = turned(vec3(b.zw, c.x));
  float iz = 1.0 / m.z, p = u.z * iz, q = v.z * iz;
  vec2 h = m.xy * iz, pu = focal * (u.xy * iz - h * p), pv = focal * (v.xy * iz - h * q);
  vec2 centre = focal * h + middle;
  float rho2 = 2.0 * LN2 * (log2Opacity + LOG2_255);
  vec2 x = extent(pu.x, pv.x, p, q, rho2), y = extent(pu.y, pv.y, p, q, rho2);
  vec3 normal = cross(u, v);
  bool seen = m.z > NEAR_PLANE && dot(normal, normal) > 0.0
    && rho2 * (p * p + q * q) - 1.0 < CAMERA_PLANE_MARGIN;
  homography = vec4(pu.x, pv.x, pu.y, pv.y);
  denominator = vec4(pu.x * pv.y - pv.x * pu.y, pu.y * q - pv.y * p, pv.x * p - pu.x * q, log2Opacity);
  place = centre;
  vec2 low = max(centre + vec2(x.x, y.x) - MARGIN, vec2(-1.0)), high = min(centre + vec2(x.y, y.y) + MARGIN, size + 1.0);
  seen = seen && all(lessThan(low, high));
  vec2 pixel = vec2((corner & 1) == 0 ? low.x : high.x, (corner & 2) == 0 ? low.y : high.y);
  gl_Position = seen ? vec4(2.0 * pixel / size - 1.0, 0.0, 1.0) : vec4(2.0, 2.0, 2.0, 1.0);
}
