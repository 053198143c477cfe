"use strict";
// Sliders, buttons, pointers and keys: they change the state of the viewer.

const find = (id) => document.getElementById(id);

/** A labelled slider; `changed` gets its number. */
function slider(parent, name, { min, max, step, value, text }, changed) {
  const label = document.createElement("label"), output = document.createElement("output");
  const input = document.createElement("input"), words = document.createElement("span");
  Object.assign(input, { type: "range", min, max, step: "any" });
  input.step = step;
  input.value = value;
  words.textContent = name;
  const show = () => {
    output.textContent = text(Number(input.value));
    input.setAttribute("aria-valuetext", output.textContent);
  };
  input.addEventListener("input", () => { show(); changed(Number(input.value)); });
  label.append(words, output, input);
  parent.append(label);
  show();
  return { set: (number) => { input.value = number; show(); }, input };
}

/** The sliders of levels, regions and the clip. */
function makeControls(viewer) {
  const { header, state } = viewer, gamma = header.levels[header.levels.length - 1];
  const range = { min: Math.min(0, 1.2 * gamma), max: Math.max(0, 1.2 * gamma), step: Math.abs(gamma) / 100 };
  const text = (level) => level.toFixed(3).replace(/(\.\d\d)0$/, "$1");
  const level = slider(find("level"), "Exaggeration", { ...range, value: state.level, text }, (value) => viewer.move({ level: value }));
  const regions = header.regions.map((region, i) => {
    const end = region.levels[region.levels.length - 1];
    const ends = { min: Math.min(0, 1.2 * end), max: Math.max(0, 1.2 * end), step: Math.abs(end) / 100, value: 0, text };
    return slider(find("regions"), region.name.replace(/_/g, " "), ends, (value) => viewer.move({ regions: { [region.name]: value } }));
  });
  find("local").hidden = regions.length === 0;
  if (matchMedia("(min-width: 50rem)").matches) find("local").open = true;
  const time = (frame) => (state.clip === null ? header.timesteps[frame] : `${(frame / viewer.motion.fps).toFixed(2)} s`);
  const clip = slider(find("time"), "Time", { min: 0, max: header.timesteps.length - 1, step: 1, value: 0, text: time },
    (value) => { viewer.pause(); viewer.showFrame(value); });
  const choice = find("motion");
  ["as captured", ...header.clips.map((one) => one.name)].forEach((name, i) => choice.add(new Option(name, i - 1)));
  choice.addEventListener("change", () => {
    const playing = viewer.playing || Number(choice.value) >= 0, at = Number(choice.value);
    viewer.pause();
    viewer.set(at < 0 ? { timestep: header.timesteps[state.place] } : { clip: header.clips[at].name, frame: 0 }).then(() => playing && viewer.play());
  });
  find("choice").hidden = header.clips.length === 0;
  const faces = header.sliders.map(({ name, low, high }) => [name, { min: low, max: high, step: (high - low) / 100, text: (value) => value.toFixed(2) }]);
  const turns = header.turning.map(({ name, degrees }) => [name, { min: name === "jaw" ? 0 : -degrees, max: degrees, step: 1, text: (value) => `${value.toFixed(0)}°` }]);
  const drive = [...faces, ...turns].map(([name, range]) => [name,
    slider(find("expressions"), name, { ...range, value: 0 }, (value) => viewer.move({ drive: { [name]: value } }))]);
  find("face").hidden = drive.length === 0;
  const grey = Math.round(255 * header.background).toString(16).padStart(2, "0");
  find("background").value = `#${grey}${grey}${grey}`;
  find("background").addEventListener("input", () => viewer.set({ background: find("background").value }));
  viewer.onChange = () => {
    level.set(state.level);
    state.regions.forEach((value, i) => regions[i].set(value));
    clip.input.max = viewer.motion.count - 1;
    clip.set(viewer.shownFrame);
    find("clip").hidden = viewer.motion.count === 1;
    choice.value = state.clip === null ? -1 : state.clip;
    drive.forEach(([name, one]) => one.set(state.drive[name] || 0));
    find("hint").classList.toggle("unseen", Math.abs(state.level) <= Math.abs(gamma) * 1.0001);
    find("play").setAttribute("aria-pressed", viewer.playing);
    find("play").textContent = viewer.playing ? "Pause" : "Play";
  };
  find("hint").textContent = `Extrapolated: trained up to ${text(gamma)}.`;
  find("play").addEventListener("click", () => (viewer.playing ? viewer.pause() : viewer.play()));
  find("reset").addEventListener("click", () => viewer.reset());
  find("save").addEventListener("click", () => viewer.save());
  find("toggle").addEventListener("click", () => viewer.toggle());
  find("record").addEventListener("click", () => viewer.record());
  find("record").hidden = typeof MediaRecorder === "undefined";
}

/** Turn with one pointer, zoom with two, the wheel or + and -; arrows turn, too. */
function makePointers(viewer, canvas) {
  const pointers = new Map(), { orbit } = viewer.state;
  const turn = (dx, dy) => viewer.move({
    azimuth: orbit.azimuth - dx, elevation: Math.min(Math.max(orbit.elevation + dy, -85), 85),
  });
  const zoom = (factor) => viewer.move({ zoom: Math.min(Math.max(orbit.zoom * factor, 0.3), 12) });
  const spread = () => {
    const [a, b] = [...pointers.values()];
    return Math.hypot(a.x - b.x, a.y - b.y);
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const apart = pointers.size === 2 ? spread() : 0, degrees = 250 / Math.max(canvas.clientHeight, 1) / Math.max(orbit.zoom, 1);
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (pointers.size === 1) turn((event.clientX - before.x) * degrees, (event.clientY - before.y) * degrees);
    else if (apart > 0) zoom(spread() / apart);
  });
  for (const kind of ["pointerup", "pointercancel"]) canvas.addEventListener(kind, (event) => pointers.delete(event.pointerId));
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0015)));
  }, { passive: false });
  canvas.addEventListener("dblclick", () => viewer.set({ azimuth: 0, elevation: 0, zoom: 1 }));
  canvas.addEventListener("keydown", (event) => {
    const actions = {
      ArrowLeft: () => turn(5, 0), ArrowRight: () => turn(-5, 0), ArrowUp: () => turn(0, 5), ArrowDown: () => turn(0, -5),
      "+": () => zoom(1.1), "=": () => zoom(1.1), "-": () => zoom(1 / 1.1), " ": () => (viewer.playing ? viewer.pause() : viewer.play()),
    };
    if (!actions[event.key]) return;
    event.preventDefault();
    actions[event.key]();
  });
}
