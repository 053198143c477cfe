#version 300 es
// Intersection of the ray through a pixel with a surfel (2D Gaussian Splatting, Huang et al. 2024, equations 8 to 11):
// carigs/splat/rasterizer/forward.py. Row 0 of the image is its top.
precision highp float;

flat in vec4 homography, denominator, places;
flat in vec3 colour;
out vec4 result;

const float HALF_LOG2E = 0.7213475204444817, LOG2_THRESHOLD = -7.994353436858858, ALPHA_CAP = 0.99;

void main() {
  vec2 d = gl_FragCoord.xy - places.xy, low = gl_FragCoord.xy - places.zw;
  float zx = homography.w * d.x - homography.y * d.y, zy = homography.x * d.y - homography.z * d.x;
  float zz = denominator.x + denominator.y * d.x + denominator.z * d.y;
  float g2 = 2.0 * dot(low, low), above = zx * zx + zy * zy, below = zz * zz;
  // Without a division where the ray grazes the surfel: then the low-pass filter holds.
  float g = above < g2 * below ? above / below : g2;
  float exponent = denominator.w - g * HALF_LOG2E;
  if (exponent < LOG2_THRESHOLD) discard;
  result = vec4(colour, min(exp2(exponent), ALPHA_CAP));
}
