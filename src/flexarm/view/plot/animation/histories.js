// Channels over time, with a cursor at the current time and a span of time that all of them show.
const CLOSEST = 2e-4; // shortest span, as a fraction of the run

function spanOf(times) {
  const last = times[times.length - 1];
  return last > times[0] ? [times[0], last] : [times[0], times[0] + 1];
}

// Index of the first time that is not before t; the number of times if there is none.
function indexAt(times, t) {
  let low = 0, high = times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] < t - 1e-9) low = middle + 1; else high = middle;
  }
  return low;
}

// Value of a line at time t, or null where it has none.
function valueAt(times, values, t) {
  const i = Math.min(indexAt(times, t), times.length - 1), h = Math.max(0, i - 1);
  if (values[i] === null || values[h] === null) return null;
  const span = times[i] - times[h];
  return values[h] + (span > 0 ? Math.min(1, (t - times[h]) / span) : 1) * (values[i] - values[h]);
}

// Times and lines of a history within a span, and the samples next to it.
function within(history, span) {
  const from = Math.max(0, indexAt(history.time, span[0]) - 1);
  const to = Math.min(history.time.length - 1, indexAt(history.time, span[1]));
  return [history.time.slice(from, to + 1), history.lines.map((values) => values.slice(from, to + 1))];
}

// Lowest and highest value of lines, with a margin.
function rangeOf(lines) {
  let low = Infinity, high = -Infinity;
  for (const values of lines) {
    for (const value of values) {
      if (value === null) continue;
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  if (low > high) return [-1, 1];
  const spare = 0.07 * (high - low) || 0.1 * Math.abs(high) || 1;
  return [low - spare, high + spare];
}

// Everything but the cursor, which is drawn once for a span and size.
function backdrop(history, labelled, span, width, height, ratio) {
  const picture = document.createElement("canvas");
  const draw = prepare(picture, width, height, ratio);
  const rows = namesBelow(draw, history, width - 74), top = 24 + ROW * rows.length;
  const box = { left: 62, top, width: width - 74, height: height - top - (labelled ? 40 : 22) };
  const [times, lines] = within(history, span);
  const [timesBefore, linesBefore] = history.previous ? within(history.previous, span) : [[], []];
  const range = rangeOf(lines.concat(linesBefore));
  const [toX, toY] = axes(draw, box, span, range, labelled ? "time [s]" : "", history.label, [6, 4]);
  draw.save();
  draw.beginPath(); draw.rect(box.left, box.top, box.width, box.height); draw.clip();
  draw.globalAlpha = 0.35;
  linesBefore.forEach((values, j) => {
    line(draw, values.map((value, i) => [timesBefore[i], value]), toX, toY, history.colors[j] || GREY, 1.5);
  });
  draw.globalAlpha = 1;
  lines.forEach((values, j) => {
    line(draw, values.map((value, i) => [times[i], value]), toX, toY, history.colors[j], 1.5);
  });
  draw.restore();
  const digits = Math.min(8, Math.max(0, 3 - Math.floor(Math.log10(range[1] - range[0]))));
  const toTime = (x) => span[0] + Math.min(1, Math.max(0, (x - box.left) / box.width)) * (span[1] - span[0]);
  return { picture, box, range, toX, toY, toTime, digits, rows };
}

function drawHistory(history, labelled, canvas, now, zoom) {
  const [draw, width, height, ratio] = context(canvas);
  const span = zoom || spanOf(history.time), key = [width, height, ratio, PAPER, ...span].join();
  if (canvas.key !== key) {
    canvas.key = key;
    canvas.still = backdrop(history, labelled, span, width, height, ratio);
  }
  const { picture, box, range, toX, toY, digits, rows } = canvas.still;
  draw.drawImage(picture, 0, 0, width, height);
  const values = history.lines.map((values) => valueAt(history.time, values, now));
  if (!printing && now >= span[0] && now <= span[1]) {
    line(draw, [[now, range[0]], [now, range[1]]], toX, toY, INK, 1);
    values.forEach((value, j) => {
      if (value !== null) dot(draw, toX(now), toY(value), 3.2, history.colors[j]);
    });
  }
  if (canvas.drag) {
    const [from, to] = canvas.drag;
    draw.fillStyle = "rgba(0, 114, 178, 0.15)";
    draw.fillRect(Math.min(from, to), box.top, Math.abs(to - from), box.height);
  }
  drawNames(draw, history, values, box, digits, range, rows);
}

const ROW = 15; // height of a row of names below the title
function namesOf(history) { return history.labels.map((label, j) => [label, history.colors[j]]); }

// Rows of names that do not fit beside the title: none if they do, or if there are too many.
function namesBelow(draw, history, width) {
  const names = namesOf(history);
  if (legendWidth(draw, names) <= width - draw.measureText(history.title).width - 12) return [];
  const rows = rowsOf(draw, names, width);
  return rows.length > 2 ? [] : rows;
}

// Title at the left; names at the right with their values, as far as they fit, or below it.
function drawNames(draw, history, values, box, digits, range, rows) {
  draw.fillStyle = INK;
  draw.textAlign = "left";
  draw.textBaseline = "middle";
  draw.fillText(history.title, box.left, 12);
  rows.forEach((row, k) => legend(draw, row, box.left + legendWidth(draw, row), 12 + ROW * (k + 1)));
  if (rows.length) return;
  const free = box.width - draw.measureText(history.title).width - 12;
  const width = Math.max(...range.map((value) => draw.measureText(value.toFixed(digits)).width));
  const text = (value) => (value === null ? "–" : value.toFixed(digits));
  const plain = namesOf(history);
  const full = plain.map(([label, color], j) => [label, color, null, text(values[j]), width]);
  const wanted = plain.length > 1 ? [plain, [plain[0], plain[plain.length - 1]]] : [[]];
  if (!printing) wanted.unshift(full);
  const shown = wanted.find((entries) => legendWidth(draw, entries) <= free);
  if (shown) legend(draw, shown, box.left + box.width, 12);
}
