// Colours, and what arms and histories have in common on their canvases.
// Hues, which change towards that of the text until they are readable on the page.
const BLUE = "#0072B2", VERMILLION = "#D55E00", GREEN = "#009E73", PURPLE = "#CC79A7";
const SKY = "#5FA9DB", ORANGE = "#E69F00", GREY = "#8C8C8C";
const TRUE = "#A8A8A8"; // the true shape behind a magnified one
let PAPER, INK, GRID, SOLID, FOOT; // of the style sheet, light or dark
const readableHues = new Map();
let printing = false; // whether the page is laid out for paper

function add(parent, tag, name, text) {
  const made = document.createElement(tag);
  if (name) made.className = name;
  if (text) made.textContent = text;
  parent.appendChild(made);
  return made;
}

const NAMES = ["paper", "ink", "grid", "solid", "foot"].map((name) => "--flexarm-" + name);
for (const name of NAMES) {
  // Registered as a colour, a pair of a light and a dark one has the value of the scheme.
  try { CSS.registerProperty({ name, syntax: "<color>", inherits: true, initialValue: "black" }); } catch { /* is registered */ }
}
function readColours() {
  const style = getComputedStyle(root);
  const pair = /light-dark\((.*?),/; // a browser without schemes shows the light one
  const colors = NAMES.map((name) => style.getPropertyValue(name).trim()).map((text) => (text.match(pair) || [text, text])[1]);
  if (colors[0] !== PAPER) readableHues.clear();
  [PAPER, INK, GRID, SOLID, FOOT] = colors;
}

function channels(color) {
  if (color[0] === "#") return [1, 3, 5].map((k) => parseInt(color.slice(k, k + 2), 16));
  return color.match(/[\d.]+/g).slice(0, 3).map(Number);
}
// Relative luminance of WCAG 2.
function luminance(color) {
  const [r, g, b] = channels(color).map((v) => (v <= 10 ? v / 3294.6 : Math.pow((v / 255 + 0.055) / 1.055, 2.4)));
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}
function readable(color) {
  if (!readableHues.has(color)) {
    const paper = luminance(PAPER) + 0.05, contrast = paper < 0.2 ? 4.5 : 3, [from, to] = [channels(color), channels(INK)];
    let mixed = color;
    for (let part = 0; part <= 1; part += 0.05) {
      mixed = "rgb(" + from.map((v, k) => Math.round(v + part * (to[k] - v))).join() + ")";
      const other = luminance(mixed) + 0.05;
      if (Math.max(paper / other, other / paper) >= contrast) break;
    }
    readableHues.set(color, mixed);
  }
  return readableHues.get(color);
}

function ticks(low, high, most) {
  const raw = (high - low) / most, power = Math.pow(10, Math.floor(Math.log10(raw)));
  const steps = [0.5, 1, 2, 5, 10].map((k) => k * power), place = steps.findIndex((k) => k >= raw * 0.999);
  const many = (k) => Math.floor(high / k) - Math.ceil(low / k) > 0; // two at least
  const step = many(steps[place]) ? steps[place] : steps[place - 1];
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return found.map((value) => [value, Math.abs(value) < 1e5 ? value.toFixed(Math.min(digits, 8)) : value.toPrecision(3)]);
}

// Clear a canvas of a size in CSS pixels, with `ratio` dots for each of them.
function prepare(canvas, width, height, ratio) {
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const draw = canvas.getContext("2d");
  draw.setTransform(ratio, 0, 0, ratio, 0, 0);
  draw.clearRect(0, 0, width, height);
  draw.font = "12px system-ui, sans-serif";
  draw.lineJoin = "round";
  return draw;
}

// Lines are sharp on every screen, and on paper at 300 dots per inch.
function context(canvas) {
  const ratio = printing ? 300 / 96 : (window.devicePixelRatio || 1) * (canvas.currentCSSZoom || 1);
  const width = canvas.clientWidth, height = canvas.clientHeight;
  return [prepare(canvas, width, height, ratio), width, height, ratio];
}

// Draw the grid and its labels in a box; return the maps from values to pixels.
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
  draw.strokeStyle = readable(color);
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
  draw.fillStyle = edge ? fill : readable(fill);
  draw.fill();
  if (edge) { draw.strokeStyle = edge; draw.lineWidth = 1; draw.stroke(); }
}

// Entries in a row, from the right: [text, color, dash, number, width of all such numbers].
function legend(draw, entries, right, y) {
  draw.textBaseline = "middle";
  let x = right;
  for (const [text, color, dash, number, reserved] of entries.slice().reverse()) {
    draw.fillStyle = INK;
    if (number) {
      draw.textAlign = "right";
      draw.fillText(number, x, y);
      x -= reserved + 6;
    }
    draw.textAlign = "left";
    x -= draw.measureText(text).width;
    draw.fillText(text, x, y);
    x -= 22;
    if (text) line(draw, [[x, y], [x + 17, y]], (v) => v, (v) => v, color, 2, dash);
    x -= 10;
  }
}

// Rows of entries, each as long as the width permits.
function rowsOf(draw, entries, width) {
  const rows = [[]];
  for (const entry of entries) {
    const row = rows[rows.length - 1];
    if (row.length && legendWidth(draw, [...row, entry]) > width) rows.push([entry]); else row.push(entry);
  }
  return rows;
}

function legendWidth(draw, entries) {
  const width = ([text, , , number, reserved]) => draw.measureText(text).width + 32 + (number ? reserved + 6 : 0);
  return entries.reduce((sum, entry) => sum + width(entry), 0);
}
