#version 300 es
// The image, whose row 0 is its top, in the window, whose row 0 is its bottom.
precision highp float;
precision highp sampler2D;
uniform sampler2D image;
uniform vec2 size;  // of the window
out vec4 result;
void main() {
  vec2 at = gl_FragCoord.xy / size;
  result = vec4(clamp(texture(image, vec2(at.x, 1.0 - at.y)).rgb, 0.0, 1.0), 1.0);
}
