"use strict";
// The viewer: its state, the worker that makes surfels of it, and the window that shows them.
//
// For scripts and tests there is `window.carigs`:
//   await carigs.ready                 the first image is drawn
//   await carigs.set({level, regions: {nose: 0.1}, timestep, clip: "talk", frame, drive: {smile: 0.5}, background: "#203040",
//                     azimuth, elevation, zoom})   drawn when it resolves; clip null is the capture
//   await carigs.image({level, regions, timestep, clip, frame, drive, camera})   data URL (PNG) of a pinhole camera, {rows, fx, fy, cx, cy,
//                                      width, height} with the first three rows of camera_from_world; without a camera
//                                      the window's
//   carigs.times                       milliseconds that the worker took for the last surfels, by part
//   carigs.header, carigs.state, carigs.firstImage (milliseconds since the page was opened)

class Viewer {
  constructor(header, worker, renderer, canvas) {
    Object.assign(this, { header, worker, renderer, canvas, playing: false, onChange: () => {} });
    this.state = {
      level: header.firstLevel, regions: header.regions.map(() => 0), place: 0, clip: null, frame: 0, drive: {}, orbit: { azimuth: 0, elevation: 0, zoom: 1 },
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
      id, place: state.place, clip: state.clip, frame: state.frame, ...this.driven(state.drive), level: state.level, regions: state.regions, eye: eyeOf(camera), away: camera.rows.slice(8, 12),
      buffer, room: this.renderer.rows * PER_ROW,
    };
    this.worker.postMessage(request, buffer ? [buffer] : []);
    return new Promise((resolve) => this.answers.set(id, resolve));
  }

  /** Amounts of the columns, and turns of the joints, of the sliders' values. */
  driven(drive) {
    const { header } = this, amounts = new Array(header.columns).fill(0), turns = new Array(3 * header.joints).fill(0);
    for (const { name, columns } of header.sliders) {
      for (const [column, weight] of columns) amounts[column] += weight * (drive[name] || 0);
    }
    for (const { name, joints, axis } of header.turning) {
      for (const joint of joints) turns[3 * joint + axis] += ((drive[name] || 0) * Math.PI) / 180;
    }
    return { amounts, turns };
  }

  /** Change the state {level, regions, timestep, clip, frame, drive, azimuth, elevation, zoom}; resolves when it is drawn. */
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
    if (change.background !== undefined) {
      this.renderer.background = [1, 3, 5].map((at) => parseInt(change.background.slice(at, at + 2), 16) / 255);
      document.body.classList.toggle("dark", this.renderer.background.reduce((a, b) => a + b) < 1.5);
    }
    for (const name of ["azimuth", "elevation", "zoom"]) if (change[name] !== undefined) this.state.orbit[name] = Number(change[name]);
    this.onChange();
    return this.redraw();
  }

  /** Level, regions, place, clip, frame and sliders of a change; what it does not name stays. */
  changed({ level = this.state.level, regions = {}, timestep, clip, frame, drive = {} }) {
    const place = timestep === undefined ? this.state.place : this.header.timesteps.indexOf(timestep);
    if (place < 0) throw new Error(`timestep ${timestep} is not in the clip`);
    const names = this.header.regions.map((region) => region.name);
    for (const name of Object.keys(regions)) if (!names.includes(name)) throw new Error(`there is no slider ${name}`);
    let at = this.state.clip;
    if (timestep !== undefined) at = null;
    if (clip !== undefined) at = clip === null ? null : this.header.clips.findIndex((one) => one.name === clip);
    if (at === -1) throw new Error(`there is no clip ${clip}`);
    const last = at === null ? 0 : this.header.clips[at].frames - 1;
    const shown = frame === undefined ? (at === this.state.clip ? this.state.frame : 0) : Math.min(Math.max(Math.floor(frame), 0), last);
    const known = [...this.header.sliders, ...this.header.turning].map((one) => one.name);
    for (const name of Object.keys(drive)) if (!known.includes(name)) throw new Error(`there is no slider ${name}`);
    const moved = { clip: at, frame: Math.min(shown, last), drive: { ...this.state.drive, ...drive } };
    return { ...moved, level: Number(level), regions: names.map((name, i) => Number(regions[name] ?? this.state.regions[i])), place };
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
    if (took > 45) this.quality = Math.max(this.quality * 0.8, 0.5);
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

  /** Frames, frames per second and sound of what is played: the capture or a clip. */
  get motion() {
    const { header, state } = this, clip = state.clip === null ? null : header.clips[state.clip];
    if (!clip) return { count: header.timesteps.length, fps: header.fps, sound: null };
    const sound = clip.sound ? find("sounds").querySelector(`[data-clip="${CSS.escape(clip.name)}"]`) : null;
    return { count: clip.frames, fps: clip.fps, sound };
  }

  /** Show a frame of the capture or of the clip. */
  showFrame(frame) {
    return this.move(this.state.clip === null ? { timestep: this.header.timesteps[frame] } : { frame });
  }

  get shownFrame() {
    return this.state.clip === null ? this.state.place : this.state.frame;
  }

  async play() {
    const motion = this.motion, { count, fps, sound } = motion;
    this.playing = true;
    this.onChange();
    if (sound) {
      sound.currentTime = this.shownFrame / fps;
      await sound.play().catch(() => {});  // browsers may refuse sound that nobody has clicked for
    }
    let start = performance.now() - (1000 * this.shownFrame) / fps;
    const { clip } = this.state;
    const step = async () => {
      if (!this.playing || this.state.clip !== clip) return sound && sound.pause();
      // Sound leads while it is heard. The clock follows it, and goes on alone where the sound ends before the frames do.
      if (sound && !sound.paused && !sound.ended) start = performance.now() - 1000 * sound.currentTime;
      let seconds = (performance.now() - start) / 1000;
      if (seconds * fps >= count) {
        seconds %= count / fps;
        start = performance.now() - 1000 * seconds;
        if (sound) {
          sound.currentTime = seconds;
          if (sound.paused || sound.ended) await sound.play().catch(() => {});
        }
      }
      const frame = Math.floor(seconds * fps) % count;
      if (frame !== this.shownFrame) await this.showFrame(frame);
      requestAnimationFrame(step);
    };
    step();
  }

  pause() {
    if (!this.playing) return;
    this.playing = false;
    const { sound } = this.motion;
    if (sound) sound.pause();
    this.set({});
  }

  /** The natural head, or the caricature that was shown before. */
  toggle() {
    if (this.state.level) this.caricature = this.state.level;
    const top = this.header.levels[this.header.levels.length - 1];
    return this.set({ level: this.state.level ? 0 : this.caricature || this.header.firstLevel || top });
  }

  reset() {
    this.pause();
    const regions = Object.fromEntries(this.header.regions.map((region) => [region.name, 0]));
    const drive = Object.fromEntries([...this.header.sliders, ...this.header.turning].map(({ name }) => [name, 0]));
    return this.set({
      level: this.header.firstLevel, regions, drive, timestep: this.header.timesteps[0], azimuth: 0, elevation: 0, zoom: 1,
    });
  }

  /** Play once from the start and save what is seen as a video. */
  async record() {
    this.pause();
    const { count, fps } = this.motion, stream = this.canvas.captureStream(30);
    const recorder = new MediaRecorder(stream, { videoBitsPerSecond: 8e6 }), parts = [];
    recorder.ondataavailable = ({ data }) => parts.push(data);
    const ended = new Promise((resolve) => { recorder.onstop = resolve; });
    await this.showFrame(0);
    recorder.start();
    this.play();
    setTimeout(() => { this.pause(); recorder.stop(); }, (1000 * count) / fps);
    await ended;
    const address = URL.createObjectURL(new Blob(parts, { type: recorder.mimeType }));
    download(address, `${document.title}.${recorder.mimeType.includes("mp4") ? "mp4" : "webm"}`);
    setTimeout(() => URL.revokeObjectURL(address), 60000);
  }

  async save() {
    download(await this.image(), `${document.title}.png`);
  }
}

function download(address, name) {
  Object.assign(document.createElement("a"), { href: address, download: name }).click();
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
