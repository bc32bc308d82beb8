// The arm at the current time; on paper its postures at several times.
const POSTURES = 9; // on paper

// Draw the scene's arm in the square `view`: middle and half of the side, m.
function drawArm(scene, canvas, middle, half, frame, span) {
  const [draw, width, height] = context(canvas);
  const lines = scene.legendLines || 1, top = 15 + 13 * lines;
  const side = Math.min(width - 64, height - 44 - top);
  const box = { left: 52, top, width: side, height: side };
  const x = [middle[0] - half, middle[0] + half], y = [middle[1] - half, middle[1] + half];
  const [toX, toY] = axes(draw, box, x, y, "x [m]", "y [m]", [6, 6]);
  canvas.map = [toX, toY]; // for pages with elements on the picture
  const entries = [];
  let title = scene.title;
  draw.save();
  draw.beginPath(); draw.rect(box.left, box.top, box.width, box.height); draw.clip();
  drawSurroundings(draw, scene, toX, toY, side);
  if (scene.reference) {
    line(draw, scene.reference, toX, toY, GREEN, 1.5, [6, 4]);
    entries.push(["reference", GREEN, [6, 4]]);
  }
  if (printing) {
    const shown = framesWithin(scene.times, span);
    frame = shown[shown.length - 1];
    const times = [scene.times[shown[0]], scene.times[frame]].map((t) => Number(t.toPrecision(4)));
    title = (title ? title + ", " : "") + "t = " + times.join(" to ") + " s";
    shown.slice(0, -1).forEach((k, place) => {
      draw.globalAlpha = 0.25 + 0.35 * place / shown.length;
      drawLinks(draw, scene, posed(scene, k), k, toX, toY, side / (2 * half));
    });
    draw.globalAlpha = 1;
  }
  const pose = posed(scene, frame), tip = tipOf(pose.links);
  if (scene.path) {
    if (scene.drawnBy !== magnify) [scene.drawnPath, scene.drawnBy] = [magnifiedPath(scene), magnify];
    const gone = scene.drawnPath.filter((_, k) => scene.pathTimes[k] <= scene.times[frame]);
    line(draw, gone.concat([tip]), toX, toY, VERMILLION, 1.5);
    entries.push(["tip" + (magnify === 1 ? "" : " × " + magnify), VERMILLION]);
  }
  if (scene.previous) {
    const before = scene.previous, last = before.times.length - 1;
    const then = Math.min(indexAt(before.times, scene.times[frame]), last);
    for (const link of magnify === 1 ? before.links[then] : magnifiedLinks(before, then)) line(draw, link, toX, toY, SKY, 2.5);
    entries.push(["previous", SKY]);
  }
  if (scene.ghost) {
    for (const link of scene.ghost[frame]) line(draw, link, toX, toY, GREY, 1.8, [6, 3]);
    entries.push(["rigid", GREY, [6, 3]]);
  }
  if (magnify !== 1) {
    for (const link of scene.links[frame]) line(draw, link, toX, toY, TRUE, 1.5);
    entries.push(["true shape", TRUE]);
  }
  drawLinks(draw, scene, pose, frame, toX, toY, side / (2 * half));
  if (pose.arrows && !printing) {
    for (const arrow of pose.arrows) line(draw, arrow, toX, toY, PURPLE, 2.2);
    entries.push(["torque", PURPLE]);
  }
  for (const [px, py] of pose.joints) dot(draw, toX(px), toY(py), 4, PAPER, INK);
  dot(draw, toX(tip[0]), toY(tip[1]), scene.payload ? 6 : 2.5, scene.payload ? ORANGE : INK, INK);
  if (scene.goal) {
    const [gx, gy] = [toX(scene.goal[frame][0]), toY(scene.goal[frame][1])];
    line(draw, [[gx - 4, gy - 4], [gx + 4, gy + 4]], (v) => v, (v) => v, GREEN, 1.5);
    line(draw, [[gx - 4, gy + 4], [gx + 4, gy - 4]], (v) => v, (v) => v, GREEN, 1.5);
  }
  draw.restore();
  const rows = rowsOf(draw, entries, side);
  if (rows.length !== lines) { // with room for all names
    scene.legendLines = rows.length;
    drawArm(scene, canvas, middle, half, frame, span);
    return;
  }
  rows.forEach((row, k) => legend(draw, row, box.left + side, 14 + 13 * k));
  draw.fillStyle = INK;
  draw.textAlign = "right";
  draw.textBaseline = "top";
  draw.fillText(title, box.left + side - 6, box.top + 6);
  draw.textAlign = "left";
  if (magnify !== 1) draw.fillText(bendingText(), box.left + 6, box.top + 6);
}

function bendingText() { return "bending × " + Number(magnify.toPrecision(3)); }

function drawSurroundings(draw, scene, toX, toY, side) {
  for (const [course, behind] of scene.solids) {
    draw.fillStyle = SOLID;
    draw.beginPath();
    course.concat(behind.slice().reverse()).forEach(([px, py]) => draw.lineTo(toX(px), toY(py)));
    draw.fill();
    line(draw, course, toX, toY, INK, 1.5);
  }
  const foot = 0.028 * side;
  draw.fillStyle = FOOT;
  for (const [px, py] of scene.feet) {
    draw.beginPath();
    draw.moveTo(toX(px), toY(py)); draw.lineTo(toX(px) - foot, toY(py) + 1.4 * foot);
    draw.lineTo(toX(px) + foot, toY(py) + 1.4 * foot); draw.closePath(); draw.fill();
  }
}

function drawLinks(draw, scene, pose, frame, toX, toY, scale) {
  draw.lineCap = "round";
  for (const rail of pose.rails) line(draw, rail, toX, toY, GREY, 1.5);
  if (scene.body) line(draw, scene.body[frame], toX, toY, GREY, 9);
  pose.links.forEach((link, k) => {
    line(draw, link, toX, toY, scene.bends[k] ? BLUE : INK, Math.max(4, scale * scene.depths[k]));
  });
  draw.lineCap = "butt";
}

// A few frames, evenly spaced in a span of time, or in the whole run.
function framesWithin(times, span) {
  const inside = times.map((_, k) => k).filter((k) => !span || (times[k] >= span[0] && times[k] <= span[1]));
  if (inside.length === 0) return [times.length - 1];
  const count = Math.min(POSTURES, inside.length);
  const place = (k) => inside[Math.round(k * (inside.length - 1) / Math.max(1, count - 1))];
  return Array.from({ length: count }, (_, k) => place(k));
}
