"use strict";
// Draws sorted surfels, the farthest first, into a texture of half floats, and the texture into the window.

const TEXELS = 4, PER_ROW = 512, FLOATS_OF_ROW = 4 * TEXELS * PER_ROW;

class Renderer {
  constructor(gl, count, background, shaders) {
    this.gl = gl;
    this.background = [background, background, background];
    this.rows = Math.max(Math.ceil(count / PER_ROW), 1);
    // Eight bits would round once per surfel.
    this.halfFloats = Boolean(gl.getExtension("EXT_color_buffer_float") || gl.getExtension("EXT_color_buffer_half_float"));
    this.surfels = new Program(gl, shaders.surfelVert, shaders.surfelFrag);
    this.window = new Program(gl, shaders.imageVert, shaders.imageFrag);
    this.content = this.texture(gl.RGBA32F, gl.RGBA, gl.FLOAT, TEXELS * PER_ROW, this.rows, gl.NEAREST);
    this.image = null;
    this.count = 0;
    this.nothing = gl.createVertexArray();
    this.quads = gl.createVertexArray();
    gl.bindVertexArray(this.quads);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, Renderer.indices(count), gl.STATIC_DRAW);
    gl.bindVertexArray(null);
  }

  static indices(count) {
    const indices = new Uint32Array(6 * count);
    for (let i = 0, to = 0; i < count; i++) for (const corner of [0, 1, 2, 2, 1, 3]) indices[to++] = 4 * i + corner;
    return indices;
  }

  texture(format, kind, type, width, height, filter) {
    const { gl } = this, texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, format, width, height, 0, kind, type, null);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, filter);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
    return texture;
  }

  /** A texture to draw into, and its framebuffer. */
  target(width, height, halfFloats) {
    const { gl } = this, framebuffer = gl.createFramebuffer();
    const texture = halfFloats
      ? this.texture(gl.RGBA16F, gl.RGBA, gl.HALF_FLOAT, width, height, gl.LINEAR)
      : this.texture(gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, width, height, gl.LINEAR);
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
    return { width, height, texture, framebuffer };
  }

  release(target) {
    this.gl.deleteFramebuffer(target.framebuffer);
    this.gl.deleteTexture(target.texture);
  }

  /** Take sorted surfels: `count` of them at the start of `content`. */
  upload(content, count) {
    const { gl } = this, rows = Math.ceil(count / PER_ROW);
    this.count = count;
    if (!rows) return;
    gl.bindTexture(gl.TEXTURE_2D, this.content);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, TEXELS * PER_ROW, rows, gl.RGBA, gl.FLOAT, content.subarray(0, rows * FLOATS_OF_ROW));
  }

  /** Draw the surfels into a target through a pinhole camera {rows, fx, fy, cx, cy, width, height} of its size. */
  drawSurfels(camera, target) {
    const { gl, surfels, background } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, target.framebuffer);
    gl.viewport(0, 0, target.width, target.height);
    gl.clearColor(...background, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.useProgram(surfels.program);
    gl.enable(gl.BLEND);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ZERO, gl.ONE);
    gl.bindTexture(gl.TEXTURE_2D, this.content);
    gl.uniform4fv(surfels.at("cameraFromWorld"), camera.rows);
    gl.uniform2f(surfels.at("focal"), camera.fx, camera.fy);
    gl.uniform2f(surfels.at("middle"), camera.cx, camera.cy);
    gl.uniform2f(surfels.at("size"), camera.width, camera.height);
    gl.bindVertexArray(this.quads);
    gl.drawElements(gl.TRIANGLES, 6 * this.count, gl.UNSIGNED_INT, 0);
    gl.disable(gl.BLEND);
  }

  /** Draw the image of a target, upright, into a framebuffer (null: the window). */
  drawImage(source, framebuffer, width, height) {
    const { gl, window } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    gl.viewport(0, 0, width, height);
    gl.useProgram(window.program);
    gl.bindTexture(gl.TEXTURE_2D, source.texture);
    gl.uniform2f(window.at("size"), width, height);
    gl.bindVertexArray(this.nothing);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  /** Show the surfels in the window, drawn at the camera's size. */
  show(camera, width, height) {
    if (!this.image || this.image.width !== camera.width || this.image.height !== camera.height) {
      if (this.image) this.release(this.image);
      this.image = this.target(camera.width, camera.height, this.halfFloats);
    }
    this.drawSurfels(camera, this.image);
    this.drawImage(this.image, null, width, height);
  }

  /** The image of a camera as ImageData. */
  read(camera) {
    const { gl } = this, { width, height } = camera;
    const drawn = this.target(width, height, this.halfFloats), bytes = this.target(width, height, false);
    this.drawSurfels(camera, drawn);
    this.drawImage(drawn, bytes.framebuffer, width, height);
    const pixels = new Uint8ClampedArray(4 * width * height), upright = new Uint8ClampedArray(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    const line = 4 * width;
    for (let y = 0; y < height; y++) upright.set(pixels.subarray(y * line, (y + 1) * line), (height - 1 - y) * line);
    this.release(drawn);
    this.release(bytes);
    return new ImageData(upright, width, height);
  }

  /** Wait until everything is drawn. */
  finish() {
    this.gl.readPixels(0, 0, 1, 1, this.gl.RGBA, this.gl.UNSIGNED_BYTE, new Uint8Array(4));
  }
}

class Program {
  constructor(gl, vertex, fragment) {
    this.gl = gl;
    this.program = gl.createProgram();
    for (const [type, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(this.program, shader);
    }
    gl.linkProgram(this.program);
    if (!gl.getProgramParameter(this.program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(this.program));
    this.places = new Map();
  }

  at(name) {
    if (!this.places.has(name)) this.places.set(name, this.gl.getUniformLocation(this.program, name));
    return this.places.get(name);
  }
}
