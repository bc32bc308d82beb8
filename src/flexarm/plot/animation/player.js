// Plays the scenes of the JSON before this script: canvases for arms and histories, one time.
(function () {
  "use strict";
  const script = document.currentScript;
  const data = JSON.parse(script.previousElementSibling.textContent);
  const root = script.previousElementSibling.previousElementSibling;
  const BLUE = "#0072B2", VERMILLION = "#D55E00", GREEN = "#009E73", PURPLE = "#CC79A7";
  const ORANGE = "#E69F00", INK = "#262626", GREY = "#8C8C8C", GRID = "#E3E3E3", SOLID = "#D9D9D9";
  const frames = data.scenes[0].times.length;
  const canvases = []; // [canvas, function that draws it]
  let frame = 0, playing = false, began = 0, beganAt = 0, rate = 1;

  function add(parent, tag, name, text) {
    const made = document.createElement(tag);
    if (name) made.className = name;
    if (text) made.textContent = text;
    parent.appendChild(made);
    return made;
  }

  function ticks(low, high, most) {
    const raw = (high - low) / most, power = Math.pow(10, Math.floor(Math.log10(raw)));
    const step = [1, 2, 5, 10].map((k) => k * power).find((k) => k >= raw * 0.999);
    const found = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    return found.map((value) => [value, Math.abs(value) < 1e5 ? value.toFixed(Math.min(digits, 8)) : value.toPrecision(3)]);
  }

  // Sharp lines on every screen: as many pixels as the screen has.
  function context(canvas) {
    const ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const draw = canvas.getContext("2d");
    draw.setTransform(ratio, 0, 0, ratio, 0, 0);
    draw.clearRect(0, 0, width, height);
    draw.font = "12px system-ui, sans-serif";
    draw.lineJoin = "round";
    return [draw, width, height];
  }

  // Box of the axes and its map from values to pixels; the grid and its labels.
  function axes(draw, box, x, y, labelX, labelY, most) {
    const toX = (v) => box.left + (v - x[0]) / (x[1] - x[0]) * box.width;
    const toY = (v) => box.top + (y[1] - v) / (y[1] - y[0]) * box.height;
    draw.lineWidth = 1;
    draw.fillStyle = INK;
    draw.strokeStyle = GRID;
    draw.textAlign = "center";
    draw.textBaseline = "top";
    for (const [v, text] of ticks(x[0], x[1], most[0])) {
      draw.beginPath(); draw.moveTo(toX(v), box.top); draw.lineTo(toX(v), box.top + box.height); draw.stroke();
      draw.fillText(text, toX(v), box.top + box.height + 4);
    }
    draw.textAlign = "right";
    draw.textBaseline = "middle";
    for (const [v, text] of ticks(y[0], y[1], most[1])) {
      draw.beginPath(); draw.moveTo(box.left, toY(v)); draw.lineTo(box.left + box.width, toY(v)); draw.stroke();
      draw.fillText(text, box.left - 5, toY(v));
    }
    draw.strokeStyle = INK;
    draw.beginPath();
    draw.moveTo(box.left, box.top); draw.lineTo(box.left, box.top + box.height);
    draw.lineTo(box.left + box.width, box.top + box.height); draw.stroke();
    draw.textAlign = "center";
    draw.textBaseline = "bottom";
    if (labelX) draw.fillText(labelX, box.left + box.width / 2, box.top + box.height + 33);
    draw.save();
    draw.translate(12, box.top + box.height / 2);
    draw.rotate(-Math.PI / 2);
    draw.textBaseline = "middle";
    draw.fillText(labelY, 0, 0);
    draw.restore();
    return [toX, toY];
  }

  function line(draw, points, toX, toY, color, width, dash) {
    draw.strokeStyle = color;
    draw.lineWidth = width;
    draw.setLineDash(dash || []);
    draw.beginPath();
    let on = false;
    for (const [x, y] of points) {
      if (x === null || y === null) { on = false; continue; }
      if (on) draw.lineTo(toX(x), toY(y)); else draw.moveTo(toX(x), toY(y));
      on = true;
    }
    draw.stroke();
    draw.setLineDash([]);
  }

  function dot(draw, x, y, radius, fill, edge) {
    draw.beginPath();
    draw.arc(x, y, radius, 0, 2 * Math.PI);
    draw.fillStyle = fill;
    draw.fill();
    if (edge) { draw.strokeStyle = edge; draw.lineWidth = 1; draw.stroke(); }
  }

  // Entries of a legend in a row, from the right.
  function legend(draw, entries, right, y) {
    draw.textBaseline = "middle";
    draw.textAlign = "left";
    let x = right;
    for (const [text, color, dash] of entries.slice().reverse()) {
      x -= draw.measureText(text).width;
      draw.fillStyle = INK;
      draw.fillText(text, x, y);
      x -= 22;
      line(draw, [[x, y], [x + 17, y]], (v) => v, (v) => v, color, 2, dash);
      x -= 10;
    }
  }

  function common(name, low) {
    const all = data.scenes.map((scene) => scene.view);
    return low ? Math.min(...all.map((v) => v[name])) : Math.max(...all.map((v) => v[name]));
  }
  // Arms side by side have one scale: a square that holds the views of all.
  const half = Math.max(common(1) - common(0, true), common(3) - common(2, true)) / 2;
  const middle = [(common(0, true) + common(1)) / 2, (common(2, true) + common(3)) / 2];

  function drawArm(scene, canvas) {
    const [draw, width, height] = context(canvas);
    const side = Math.min(width - 64, height - 72);
    const box = { left: 52, top: 28, width: side, height: side };
    const x = [middle[0] - half, middle[0] + half], y = [middle[1] - half, middle[1] + half];
    const [toX, toY] = axes(draw, box, x, y, "x [m]", "y [m]", [6, 6]);
    const scale = side / (2 * half), entries = [];
    draw.save();
    draw.beginPath(); draw.rect(box.left, box.top, box.width, box.height); draw.clip();
    for (const [course, behind] of scene.solids) {
      draw.fillStyle = SOLID;
      draw.beginPath();
      course.concat(behind.slice().reverse()).forEach(([px, py]) => draw.lineTo(toX(px), toY(py)));
      draw.fill();
      line(draw, course, toX, toY, INK, 1.5);
    }
    const foot = 0.028 * side;
    draw.fillStyle = "#BFBFBF";
    draw.beginPath();
    draw.moveTo(toX(0), toY(0)); draw.lineTo(toX(0) - foot, toY(0) + 1.4 * foot);
    draw.lineTo(toX(0) + foot, toY(0) + 1.4 * foot); draw.closePath(); draw.fill();
    if (scene.reference) {
      line(draw, scene.reference, toX, toY, GREEN, 1.5, [6, 4]);
      entries.push(["reference", GREEN, [6, 4]]);
    }
    const links = scene.links[frame], tip = links[links.length - 1].slice(-1)[0];
    if (scene.path) {
      const gone = scene.path.filter((_, k) => scene.pathTimes[k] <= scene.times[frame]);
      line(draw, gone.concat([tip]), toX, toY, VERMILLION, 1.5);
      entries.push(["tip", VERMILLION]);
    }
    if (scene.ghost) {
      for (const link of scene.ghost[frame]) line(draw, link, toX, toY, GREY, 1.8, [6, 3]);
      entries.push(["rigid", GREY, [6, 3]]);
    }
    draw.lineCap = "round";
    links.forEach((link, k) => {
      line(draw, link, toX, toY, scene.bends[k] ? BLUE : INK, Math.max(4, scale * scene.depths[k]));
    });
    draw.lineCap = "butt";
    if (scene.arrows) {
      for (const arrow of scene.arrows[frame]) line(draw, arrow, toX, toY, PURPLE, 2.2);
      entries.push(["torque", PURPLE]);
    }
    for (const [px, py] of scene.joints[frame]) dot(draw, toX(px), toY(py), 4, "white", INK);
    dot(draw, toX(tip[0]), toY(tip[1]), scene.payload ? 6 : 2.5, scene.payload ? ORANGE : INK);
    if (scene.goal) {
      const [gx, gy] = [toX(scene.goal[frame][0]), toY(scene.goal[frame][1])];
      line(draw, [[gx - 4, gy - 4], [gx + 4, gy + 4]], (v) => v, (v) => v, GREEN, 1.5);
      line(draw, [[gx - 4, gy + 4], [gx + 4, gy - 4]], (v) => v, (v) => v, GREEN, 1.5);
    }
    draw.restore();
    legend(draw, entries, box.left + side, 14);
    draw.fillStyle = INK;
    draw.textAlign = "right";
    draw.textBaseline = "top";
    draw.fillText(scene.title, box.left + side - 6, box.top + 6);
  }

  function drawHistory(scene, history, last, canvas) {
    const [draw, width, height] = context(canvas);
    const box = { left: 62, top: 24, width: width - 74, height: height - (last ? 64 : 46) };
    const values = history.lines.flat().filter((v) => v !== null);
    let low = Math.min(...values), high = Math.max(...values);
    const spare = 0.07 * (high - low) || 0.1 * Math.abs(high) || 1;
    low -= spare; high += spare;
    const time = [history.time[0], history.time[history.time.length - 1]];
    if (time[1] === time[0]) time[1] += 1;
    const [toX, toY] = axes(draw, box, time, [low, high], last ? "time [s]" : "", history.label, [6, 4]);
    const now = scene.times[frame], k = history.time.findIndex((t) => t >= now - 1e-9);
    history.lines.forEach((values, j) => {
      line(draw, values.map((v, i) => [history.time[i], v]), toX, toY, history.colors[j], 1.5);
    });
    line(draw, [[now, low], [now, high]], toX, toY, INK, 1);
    history.lines.forEach((values, j) => {
      const i = k < 0 ? values.length - 1 : k, h = Math.max(0, i - 1);
      const span = history.time[i] - history.time[h];
      const part = span > 0 ? (now - history.time[h]) / span : 1;
      const value = values[h] + part * (values[i] - values[h]);
      dot(draw, toX(now), toY(value), 3.2, history.colors[j]);
    });
    draw.fillStyle = INK;
    draw.textAlign = "left";
    draw.textBaseline = "middle";
    draw.fillText(history.title, box.left, 12);
    const names = history.labels.map((text, j) => [text, history.colors[j]]);
    if (names.length > 1) legend(draw, names.length > 4 ? [names[0], names[names.length - 1]] : names, box.left + box.width, 12);
    canvas.seek = (pixel) => {
      const wanted = time[0] + (pixel - box.left) / box.width * (time[1] - time[0]);
      const after = scene.times.findIndex((t) => t >= wanted);
      show(after < 0 ? frames - 1 : after);
    };
  }

  const scenes = add(root, "div", data.scenes.length === 1 ? "scenes alone" : "scenes");
  for (const scene of data.scenes) {
    const place = add(scenes, "div", "scene");
    const arm = add(add(place, "div", "arm"), "canvas");
    arm.setAttribute("role", "img");
    arm.setAttribute("aria-label", "the arm " + scene.title);
    canvases.push([arm, () => drawArm(scene, arm)]);
    if (!scene.histories.length) continue;
    const column = add(place, "div", "histories");
    scene.histories.forEach((history, k) => {
      const canvas = add(column, "canvas");
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", history.title + " over time");
      canvases.push([canvas, () => drawHistory(scene, history, k === scene.histories.length - 1, canvas)]);
      const seek = (event) => { if (event.buttons) { stop(); canvas.seek(event.offsetX); } };
      canvas.addEventListener("pointerdown", seek);
      canvas.addEventListener("pointermove", seek);
    });
  }
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
    const option = add(speeds, "option", "", k + " ×");
    option.value = k; option.selected = k === 1;
  }

  function show(k) {
    frame = Math.max(0, Math.min(frames - 1, k));
    slider.value = frame;
    const longest = data.scenes.reduce((a, b) => (b.times[frame] > a.times[frame] ? b : a));
    clock.textContent = "t = " + longest.times[frame].toFixed(3) + " s";
    for (const [, draw] of canvases) draw();
  }
  function start() {
    if (frame === frames - 1) show(0);
    playing = true; began = performance.now(); beganAt = frame;
    button.textContent = "Pause";
    requestAnimationFrame(step);
  }
  function stop() { playing = false; button.textContent = "Play"; }
  function step(now) {
    if (!playing) return;
    const next = beganAt + Math.floor(Math.max(0, now - began) / 1000 * data.fps * rate);
    if (next !== frame) show(next);
    if (frame === frames - 1) stop(); else requestAnimationFrame(step);
  }
  button.addEventListener("click", () => (playing ? stop() : start()));
  slider.addEventListener("input", () => { stop(); show(Number(slider.value)); });
  speeds.addEventListener("change", () => {
    rate = Number(speeds.value); began = performance.now(); beganAt = frame;
  });
  window.addEventListener("resize", () => show(frame));
  window.addEventListener("beforeprint", () => show(frame));
  show(0);
})();
