// Plays the scenes of `data` in the element `root`: canvases for arms and histories, one time.
const canvases = []; // [canvas, function that draws it]
// Readers who ask their system for less motion start the animation themselves, and it plays once.
const calm = window.matchMedia("(prefers-reduced-motion: reduce)").matches;
const REST = 0.8; // s at the end of the run, before it plays again
let frame = 0, playing = false, began = 0, beganAt = 0, rate = 1, visible = true;
let zoom = null; // span of time that all histories show; null for the whole run
let frames, timed, run, middle, half;

// Number of frames, spans of time, and the square that holds the views of all scenes and ghosts.
function measure() {
  frames = data.scenes[0].times.length;
  timed = data.scenes.flatMap((scene) => scene.histories.map((history) => spanOf(history.time)));
  run = [Math.min(...timed.map((span) => span[0])), Math.max(...timed.map((span) => span[1]))];
  const views = data.scenes.flatMap((scene) => (scene.previous ? [scene.view, scene.previous.view] : [scene.view]));
  const extreme = (name, choose) => choose(...views.map((view) => view[name]));
  const [left, right] = [extreme(0, Math.min), extreme(1, Math.max)];
  const [bottom, top] = [extreme(2, Math.min), extreme(3, Math.max)];
  half = Math.max(right - left, top - bottom) / 2;
  middle = [(left + right) / 2, (bottom + top) / 2];
}

function addCanvas(parent, label, draw) {
  const canvas = add(parent, "canvas");
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", label);
  // A hidden canvas has no size.
  canvases.push([canvas, () => { if (canvas.clientWidth && canvas.clientHeight) draw(canvas); }]);
  return canvas;
}

// The histories `from` to `to` of scene s; in a stack only the lowest has a label of the time.
function addHistories(parent, s, from, to, stacked) {
  if (to <= from) return;
  const column = add(parent, "div", "histories");
  for (let k = from; k < to; k++) {
    const labelled = !stacked || k === to - 1;
    const draw = (canvas) => {
      const scene = data.scenes[s];
      drawHistory(scene.histories[k], labelled, canvas, scene.times[frame], zoom);
    };
    interact(addCanvas(column, data.scenes[s].histories[k].title + " over time", draw));
  }
}

const scenes = add(root, "div");
function build() {
  canvases.length = 0;
  scenes.replaceChildren();
  scenes.className = data.scenes.length === 1 ? "scenes alone" : "scenes";
  data.scenes.forEach((scene, s) => {
    const place = add(scenes, "div", "scene"), count = scene.histories.length;
    const beside = Math.min(count, data.beside);
    addCanvas(add(place, "div", "arm"), "the arm " + scene.title, (canvas) => {
      drawArm(data.scenes[s], canvas, middle, half, frame, zoom);
    });
    addHistories(place, s, 0, beside, true);
    if (count > beside) addHistories(add(scenes, "div", "below"), s, beside, count, false);
  });
}
measure();
build();
const controls = add(root, "div", "controls");
const button = add(controls, "button", "play", "Play");
button.type = "button";
const slider = add(controls, "input", "time");
slider.type = "range"; slider.min = 0; slider.max = frames - 1; slider.step = 1; slider.value = 0;
slider.setAttribute("aria-label", "time");
const clock = add(controls, "span", "clock");
const speeds = add(controls, "select", "speed");
speeds.setAttribute("aria-label", "speed");
for (const k of [0.1, 0.25, 0.5, 1, 2]) {
  const option = add(speeds, "option", "", Number((k * data.speed).toPrecision(3)) + " ×");
  option.value = k; option.selected = k === 1;
}
const bending = add(controls, "label", "bending");
const bendingValue = add(bending, "span"), factors = add(bending, "input");
factors.type = "range"; factors.min = 0; factors.step = 1;
factors.setAttribute("aria-label", "factor on the drawn bending");
let steps = []; // factors of the slider, of which each is 1, 2 or 5 times a power of ten
function setFactors() {
  const chosen = data.scenes[0].magnify;
  steps = [0, 1, 2, 3, 4].flatMap((k) => [1, 2, 5].map((n) => n * Math.pow(10, k)));
  steps = steps.filter((step) => step <= Math.max(10, 10 * chosen) && step <= 10000);
  if (!steps.includes(chosen)) steps = steps.concat([chosen]).sort((a, b) => a - b);
  factors.max = steps.length - 1;
  setMagnify(chosen);
  bending.hidden = !data.scenes.some((scene) => scene.bends.some(Boolean));
}
function setMagnify(factor) {
  magnify = factor;
  factors.value = steps.indexOf(factor);
  bendingValue.textContent = bendingText();
}
factors.addEventListener("input", () => { setMagnify(steps[Number(factors.value)]); redraw(); });
const zooming = [
  ["zoom-in", "Zoom in", () => scaleZoom(0.5)],
  ["zoom-out", "Zoom out", () => scaleZoom(2)],
  ["zoom-reset", "Whole run", () => setZoom(null)],
].slice(0, timed.length ? 3 : 0).map(([name, text, call]) => {
  const made = add(controls, "button", name, text);
  made.type = "button";
  made.addEventListener("click", call);
  return made;
});
if (timed.length) {
  const words = "Drag across a history to zoom in, double-click for the whole run, click to go to a time.";
  add(root, "p", "hint", words);
}

function timeNow() { return Math.max(...data.scenes.map((scene) => scene.times[frame])); }

function redraw() {
  readColours();
  for (const [, draw] of canvases) draw();
}

function show(k) {
  frame = Math.max(0, Math.min(frames - 1, k));
  slider.value = frame;
  const now = timeNow();
  clock.textContent = "t = " + now.toFixed(3) + " s";
  if (zoom && (now < zoom[0] || now > zoom[1])) {
    const span = zoom[1] - zoom[0], start = now < zoom[0] ? now - 0.9 * span : now - 0.1 * span;
    setZoom([start, start + span]);
  } else redraw();
}

// The nearest frame to a time.
function nearest(t) {
  const longest = data.scenes.reduce((a, b) => (b.times[frames - 1] > a.times[frames - 1] ? b : a));
  const after = Math.min(indexAt(longest.times, t), frames - 1), before = Math.max(0, after - 1);
  return t - longest.times[before] < longest.times[after] - t ? before : after;
}
function seek(t) {
  stop();
  show(nearest(t));
}

// Show a span of time in all histories, within the run; null for the whole run.
function setZoom(span) {
  const whole = run[1] - run[0];
  zoom = null;
  if (span && span[1] - span[0] < 0.999 * whole) {
    const width = Math.max(span[1] - span[0], CLOSEST * whole);
    const start = Math.min(Math.max(0.5 * (span[0] + span[1] - width), run[0]), run[1] - width);
    zoom = [start, start + width];
  }
  for (const made of zooming.slice(1)) made.disabled = !zoom;
  redraw();
}

// Change the span by a factor; the given time stays at its place.
function scaleZoom(factor, t) {
  const [from, to] = zoom || run, fixed = t === undefined ? Math.min(Math.max(timeNow(), from), to) : t;
  setZoom([fixed + factor * (from - fixed), fixed + factor * (to - fixed)]);
}

function interact(canvas) {
  canvas.tabIndex = 0;
  const draw = canvases[canvases.length - 1][1];
  canvas.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    stop();
    canvas.drag = [event.offsetX, event.offsetX];
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (canvas.drag) { canvas.drag[1] = event.offsetX; draw(); }
  });
  canvas.addEventListener("pointerup", () => {
    if (!canvas.drag) return;
    const [from, to] = canvas.drag, time = canvas.still.toTime;
    canvas.drag = null;
    if (Math.abs(to - from) < 5) seek(time(from));
    else setZoom([time(Math.min(from, to)), time(Math.max(from, to))]);
  });
  canvas.addEventListener("pointercancel", () => { canvas.drag = null; draw(); });
  canvas.addEventListener("dblclick", () => setZoom(null));
  canvas.addEventListener("wheel", (event) => { // without Ctrl the wheel scrolls the page
    if (!event.ctrlKey && !event.metaKey) return;
    event.preventDefault();
    scaleZoom(Math.exp(Math.min(50, Math.max(-50, event.deltaY)) / 100), canvas.still.toTime(event.offsetX));
  }, { passive: false });
  const keys = {
    ArrowLeft: () => { stop(); show(frame - 1); }, ArrowRight: () => { stop(); show(frame + 1); },
    "+": () => scaleZoom(0.5), "-": () => scaleZoom(2), 0: () => setZoom(null), " ": toggle,
  };
  canvas.addEventListener("keydown", (event) => {
    if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    keys[event.key]();
  });
}

function start() {
  if (frame === frames - 1) show(0);
  playing = true; began = performance.now(); beganAt = frame;
  button.textContent = "Pause";
  requestAnimationFrame(step);
}
function stop() { playing = false; button.textContent = "Play"; }
function toggle() { if (playing) stop(); else start(); }
function step(now) {
  if (!playing) return;
  if (!visible) { began = now; beganAt = frame; }
  const next = beganAt + Math.floor(Math.max(0, now - began) / 1000 * data.fps * rate);
  if (calm && next >= frames - 1) { show(frames - 1); stop(); return; }
  if (next > frames - 1 + REST * data.fps) { began = now; beganAt = 0; show(0); }
  else if (Math.min(next, frames - 1) !== frame) show(next);
  requestAnimationFrame(step);
}
button.addEventListener("click", toggle);
slider.addEventListener("input", () => { stop(); show(Number(slider.value)); });
speeds.addEventListener("change", () => {
  rate = Number(speeds.value); began = performance.now(); beganAt = frame;
});
window.addEventListener("resize", redraw);
window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);

// Paper gets a fixed width, so that text in the figures keeps its size.
function layOut(paper) {
  printing = paper;
  root.className = "flexarm-player" + (paper ? " printing" : "");
  document.documentElement.style.colorScheme = paper ? "light" : ""; // registered colours are those of the root
  redraw();
}
window.addEventListener("beforeprint", () => layOut(true));
window.addEventListener("afterprint", () => layOut(false));
setFactors();
setZoom(null);
show(0);
if (window.IntersectionObserver) {
  new IntersectionObserver((entries) => { visible = entries[entries.length - 1].isIntersecting; }).observe(root);
}
if (!calm && frames > 1) start();

// Show other data at the time that is shown, in the same canvases if the histories are the same;
// `fresh` data of another arm by the factor on the bending that was chosen for them.
function load(next, previous, fresh) {
  const titles = () => data.scenes.map((scene) => scene.histories.map((history) => history.title)).join();
  const now = timeNow(), before = titles();
  data = next;
  if (fresh) setFactors(); else keepMagnify();
  data.scenes.forEach((scene, s) => setPrevious(scene, previous && previous.scenes[s]));
  measure();
  if (titles() !== before) build();
  for (const [canvas] of canvases) canvas.key = null;
  slider.max = frames - 1;
  frame = Math.min(frame, frames - 1);
  began = performance.now();
  beganAt = nearest(now);
  setZoom(zoom);
  show(beganAt);
}

// Keep the factor on the bending, so that runs can be compared, unless the bending would be drawn
// much larger or smaller than by the factor that was chosen for the run.
function keepMagnify() {
  const kept = magnify;
  setFactors();
  const change = kept / magnify;
  if (steps.includes(kept) && change < 6 && change > 1 / 6) setMagnify(kept);
}

// Set or remove a ghost. It is copied without its own ghost, which would keep all earlier runs.
function setPrevious(scene, before) {
  const names = ["times", "links", "view", "turns", "carriers"];
  scene.previous = before && Object.fromEntries(names.map((name) => [name, before[name]]));
  for (const history of scene.histories) {
    const same = (one) => one.title === history.title && one.label === history.label;
    const old = before && before.histories.find(same);
    history.previous = old && { time: old.time, lines: old.lines };
  }
}
