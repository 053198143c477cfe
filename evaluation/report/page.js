"use strict";
// One slider for the images of each subject. Without this script all levels are shown.
for (const strip of document.querySelectorAll("[data-strip]")) {
  const levels = [...strip.querySelectorAll("[data-level]")];
  const label = document.createElement("label");
  const slider = document.createElement("input");
  const output = document.createElement("output");
  Object.assign(slider, { type: "range", min: 0, max: levels.length - 1, step: 1 });
  slider.value = levels.length - 1;
  const show = () => {
    const chosen = Number(slider.value);
    levels.forEach((level, i) => level.classList.toggle("unshown", i !== chosen));
    output.textContent = levels[chosen].dataset.level;
    slider.setAttribute("aria-valuetext", "level " + levels[chosen].dataset.level);
  };
  slider.addEventListener("input", show);
  label.append("Caricature level ", slider, " ", output);
  label.className = "slider";
  strip.prepend(label);
  show();
}
