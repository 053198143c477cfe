"use strict";
// The viewer: its state, the worker that makes surfels of it, and the window that shows them.
//
// For scripts and tests there is `window.carigs`:
//   await carigs.ready                 the first image is drawn
//   await carigs.set({level, regions: {nose: 0.1}, timestep, azimuth, elevation, zoom})   drawn when it resolves
//   await carigs.image({level, regions, timestep, camera})   data URL (PNG) of a pinhole camera, {rows, fx, fy, cx, cy,
//                                      width, height} with the first three rows of camera_from_world; without a camera
//                                      the window's
//   carigs.times                       milliseconds that the worker took for the last surfels, by part
//   carigs.header, carigs.state, carigs.firstImage (milliseconds since the page was opened)

class Viewer {
  constructor(header, worker, renderer, canvas) {
    Object.assign(this, { header, worker, renderer, canvas, playing: false, onChange: () => {} });
    this.state = {
      level: header.firstLevel, regions: header.regions.map(() => 0), place: 0, orbit: { azimuth: 0, elevation: 0, zoom: 1 },
    };
    this.answers = new Map();
    this.spare = null;  // a buffer that goes to and fro
    this.number = 0;
    this.moved = -Infinity;
    this.quality = 1;  // pixels drawn over those of the window, along a side
    this.times = {};
    this.drawn = Promise.resolve();
    worker.onmessage = ({ data }) => {
      if (data.error) return fail(data.error);
      this.answers.get(data.id)(data);
      this.answers.delete(data.id);
    };
    new ResizeObserver(() => this.redraw()).observe(canvas);
  }

  /** Surfels of a state, seen by a camera. */
  surfels(state, camera) {
    const id = ++this.number, buffer = this.spare;
    this.spare = null;
    const request = {
      id, place: state.place, level: state.level, regions: state.regions, eye: eyeOf(camera), away: camera.rows.slice(8, 12),
      buffer, room: this.renderer.rows * PER_ROW,
    };
    this.worker.postMessage(request, buffer ? [buffer] : []);
    return new Promise((resolve) => this.answers.set(id, resolve));
  }

  /** Change the state {level, regions, timestep, azimuth, elevation, zoom}; resolves when it is drawn. */
  set(change) {
    this.moved = -Infinity;
    return this.change(change);
  }

  /** The same while a slider or a pointer moves: slow computers draw fewer pixels, and all of them a little later. */
  move(change) {
    this.moved = performance.now();
    return this.change(change);
  }

  change(change) {
    this.state = Object.assign(this.state, this.changed(change));
    for (const name of ["azimuth", "elevation", "zoom"]) if (change[name] !== undefined) this.state.orbit[name] = Number(change[name]);
    this.onChange();
    return this.redraw();
  }

  /** Level, regions and place of a change; what it does not name stays. */
  changed({ level = this.state.level, regions = {}, timestep }) {
    const place = timestep === undefined ? this.state.place : this.header.timesteps.indexOf(timestep);
    if (place < 0) throw new Error(`timestep ${timestep} is not in the clip`);
    const names = this.header.regions.map((region) => region.name);
    for (const name of Object.keys(regions)) if (!names.includes(name)) throw new Error(`there is no slider ${name}`);
    return { level: Number(level), regions: names.map((name, i) => Number(regions[name] ?? this.state.regions[i])), place };
  }

  /** Draw the state; while it is being drawn, calls join the next drawing. */
  redraw() {
    if (!this.next) {
      this.next = this.drawn.then(() => {
        this.next = null;
        return (this.drawn = this.draw());
      });
    }
    return this.next;
  }

  async draw() {
    const ratio = Math.min(devicePixelRatio || 1, 2), { canvas } = this;
    const width = Math.max(Math.round(canvas.clientWidth * ratio), 1), height = Math.max(Math.round(canvas.clientHeight * ratio), 1);
    const moving = this.playing || performance.now() - this.moved < 250, quality = moving ? this.quality : 1;
    const camera = orbitCamera(this.state.orbit, this.header, width, height);
    const found = await this.surfels(this.state, camera);
    await nextFrame();
    const start = performance.now();
    this.show(found);
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    this.renderer.show(resized(camera, Math.max(Math.round(width * quality), 1), Math.max(Math.round(height * quality), 1)), width, height);
    if (moving) this.adapt(start);
    clearTimeout(this.sharpen);
    if (quality < 1) this.sharpen = setTimeout(() => this.redraw(), 300);
  }

  show(found) {
    this.renderer.upload(found.content, found.count);
    this.spare = found.content.buffer;
    this.times = found.times;
  }

  /** Fewer pixels while the head moves, if drawing takes long. */
  adapt(start) {
    this.renderer.finish();
    const took = performance.now() - start;
    if (took > 45) this.quality = Math.max(this.quality * 0.8, 0.35);
    else if (took < 15) this.quality = Math.min(this.quality * 1.1, 1);
  }

  /** Data URL of the image of a state and a camera; what is not named is that of the window. */
  async image({ camera, ...change } = {}) {
    const state = this.changed(change);
    const view = camera || orbitCamera(this.state.orbit, this.header, this.canvas.width, this.canvas.height);
    await this.drawn;
    this.drawn = this.surfels(state, view).then((found) => {
      this.show(found);
      return this.renderer.read(view);
    });
    const pixels = await this.drawn;
    const canvas = Object.assign(document.createElement("canvas"), { width: view.width, height: view.height });
    canvas.getContext("2d").putImageData(pixels, 0, 0);
    return canvas.toDataURL("image/png");
  }

  play() {
    this.playing = true;
    const start = performance.now() - (1000 * this.state.place) / this.header.fps, count = this.header.timesteps.length;
    const step = async () => {
      if (!this.playing) return;
      const place = Math.floor(((performance.now() - start) * this.header.fps) / 1000) % count;
      if (place !== this.state.place) await this.move({ timestep: this.header.timesteps[place] });
      requestAnimationFrame(step);
    };
    step();
    this.onChange();
  }

  pause() {
    if (!this.playing) return;
    this.playing = false;
    this.set({});
  }

  reset() {
    this.pause();
    const regions = Object.fromEntries(this.header.regions.map((region) => [region.name, 0]));
    return this.set({ level: this.header.firstLevel, regions, timestep: this.header.timesteps[0], azimuth: 0, elevation: 0, zoom: 1 });
  }

  async save() {
    const link = document.createElement("a");
    link.href = await this.image();
    link.download = `${document.title}.png`;
    link.click();
  }
}

/** Until the window is painted next; in a hidden window, which is not painted, a moment. */
function nextFrame() {
  return new Promise((resolve) => {
    requestAnimationFrame(resolve);
    setTimeout(resolve, 250);
  });
}

/** Say why nothing is shown; the picture stays. */
function fail(message) {
  find("message").textContent = message;
  find("message").hidden = false;
  document.body.classList.add("failed");
}

async function start() {
  const canvas = find("view"), header = JSON.parse(find("header").textContent);
  const gl = canvas.getContext("webgl2", { alpha: false, antialias: false, depth: false, powerPreference: "high-performance" });
  if (!gl) return fail("This browser shows a picture only: it has no WebGL 2, or hardware acceleration is switched off.");
  if (typeof DecompressionStream === "undefined") return fail("This browser shows a picture only: it is too old to unpack the avatar.");
  canvas.addEventListener("webglcontextlost", () => fail("The graphics processor has dropped the image: reload the page."));
  const text = find("worker").textContent, address = URL.createObjectURL(new Blob([text], { type: "text/javascript" }));
  const worker = new Worker(address);
  worker.onerror = (event) => fail(event.message || "The avatar could not be unpacked.");
  const count = await new Promise((resolve, reject) => {
    worker.onmessage = ({ data }) => (data.ready ? resolve(data.count) : reject(new Error(data.error)));
    worker.postMessage({ header, data: find("data").textContent });
  });
  URL.revokeObjectURL(address);
  find("data").remove();
  const shaders = Object.fromEntries(["surfelVert", "surfelFrag", "imageVert", "imageFrag"].map((id) => [id, find(id).textContent]));
  const viewer = new Viewer(header, worker, new Renderer(gl, count, header.background, shaders), canvas);
  window.carigs = Object.assign(viewer, { ready: window.carigs.ready });
  makeControls(viewer);
  makePointers(viewer, canvas);
  await viewer.set({});
  viewer.renderer.finish();
  viewer.firstImage = performance.now();
  document.body.classList.add("ready");
}

window.carigs = { ready: start().catch((error) => fail(String((error && error.message) || error))) };
