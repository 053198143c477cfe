#version 300 es
// Intersection of the ray through a pixel with a surfel (2D Gaussian Splatting, Huang et al. 2024, equations 8 to 10):
// carigs/splat/rasterizer/forward.py. Row 0 of the image is its top.
precision highp float;

flat in vec4 homography, denominator;
flat in vec2 place;
flat in vec3 colour;
out vec4 result;

const float HALF_LOG2E = 0.7213475204444817, LOG2_THRESHOLD = -7.994353436858858, ALPHA_CAP = 0.99;

void main() {
  vec2 d = gl_FragCoord.xy - place;
  float zx = homography.w * d.x - homography.y * d.y, zy = homography.x * d.y - homography.z * d.x;
  float zz = denominator.x + denominator.y * d.x + denominator.z * d.y;
  float above = (zx * zx + zy * zy) * HALF_LOG2E, below = zz * zz;
  // Without a division where the ray grazes the surfel.
  if (above > (denominator.w - LOG2_THRESHOLD) * below || below == 0.0) discard;
  float exponent = denominator.w - above / below;
  result = vec4(colour, min(exp2(exponent), ALPHA_CAP));
}
