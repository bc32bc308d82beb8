// Bending drawn by a factor: the rules of plot/magnified.py, at one frame of a scene.
let magnify = 1;

function turned([x, y], angle) {
  const cosine = Math.cos(angle), sine = Math.sin(angle);
  return [cosine * x - sine * y, sine * x + cosine * y];
}

function segmentAt(share, points) {
  const place = Math.min(share, 1) * (points - 1), k = Math.min(Math.floor(place), points - 2);
  return [k, place - k];
}

function between([x, y], [toX, toY], part) { return [x + part * (toX - x), y + part * (toY - y)]; }

function pointAt(link, share) {
  const [k, part] = segmentAt(share, link.length);
  return between(link[k], link[k + 1], part);
}

// Drawn place of a point that a section of a link carries.
function carried(scene, frame, drawn, point, [i, share]) {
  if (i < 0 || point[0] === null) return point;
  const link = scene.links[frame][i], before = pointAt(link, share), after = pointAt(drawn[i], share);
  let away = [point[0] - before[0], point[1] - before[1]];
  if (scene.turns) {
    const [k] = segmentAt(share, link.length);
    away = turned(away, (magnify - 1) * scene.turns[frame][i][k]);
  }
  return [after[0] + away[0], after[1] + away[1]];
}

function magnifiedLinks(scene, frame) {
  const drawn = [];
  scene.links[frame].forEach((link, i) => {
    const last = link.length - 1;
    if (scene.turns) {
      const points = [carried(scene, frame, drawn, link[0], scene.carriers.links[i])];
      for (let s = 0; s < last; s++) {
        const step = [link[s + 1][0] - link[s][0], link[s + 1][1] - link[s][1]];
        const [x, y] = turned(step, (magnify - 1) * scene.turns[frame][i][s]);
        points.push([points[s][0] + x, points[s][1] + y]);
      }
      drawn.push(points);
    } else drawn.push(link.map((point, s) => between(between(link[0], link[last], s / last), point, magnify)));
  });
  return drawn;
}

// What is drawn of a frame: links, joints, rails and arrows.
function posed(scene, frame) {
  const [links, joints, rails] = [scene.links[frame], scene.joints[frame], scene.rails[frame]];
  const arrows = scene.arrows && scene.arrows[frame];
  if (magnify === 1) return { links, joints, rails, arrows };
  const drawn = magnifiedLinks(scene, frame), by = scene.carriers;
  const move = (point, place) => carried(scene, frame, drawn, point, place);
  const moveAll = (lines, places) => lines.map((points, k) => points.map((point) => move(point, places[k])));
  return {
    links: drawn,
    joints: joints.map((point, k) => move(point, by.joints[k])),
    rails: moveAll(rails, by.rails),
    arrows: arrows && moveAll(arrows, by.arrows),
  };
}

function tipOf(links) { return links[links.length - 1].slice(-1)[0]; }

// The path of the drawn tip: exact at the frames; between them its bending is scaled.
function magnifiedPath(scene) {
  if (magnify === 1 || !scene.turns) return scene.path;
  const scaled = scene.path.map((point, k) => between(scene.straightPath[k], point, magnify));
  const tips = scene.times.map((_, frame) => tipOf(magnifiedLinks(scene, frame)));
  const parts = [0, 1].map((axis) => {
    const along = scaled.map((point) => point[axis]);
    const away = tips.map((tip, frame) => tip[axis] - valueAt(scene.pathTimes, along, scene.times[frame]));
    return along.map((value, k) => value + valueAt(scene.times, away, scene.pathTimes[k]));
  });
  return parts[0].map((x, k) => [x, parts[1][k]]);
}
