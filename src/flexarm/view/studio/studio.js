// Shows the newest picture of a window; `makePlayer` is the function of the player.
window.flexarmStudio = (function () {
  "use strict";
  let load = null; // of the player, once there is one
  let shown = 0; // number of the picture that is shown
  let current = null; // its data
  let ghost = null; // data of the run before it
  let settled = null; // data of the last picture of a released slider: the ghost of the next one
  let fresh = false; // whether the next picture is of another arm
  const wanted = { rigid: true, previous: true }; // which ghosts are drawn

  // The server answers with the number of the picture alone if it is shown already.
  async function show(key) {
    const answer = await fetch("picture/" + key + "?shown=" + shown, { cache: "no-store" });
    if (!answer.ok) return;
    const number = Number(answer.headers.get("X-Number"));
    const data = answer.status === 200 ? await answer.json() : current;
    if (number < shown) return; // an older answer was slower
    if (number > shown) {
      [shown, current, ghost] = [number, data, settled];
      draw();
    }
    const picture = document.querySelector(".picture");
    // The picture of a released slider stays one, even if an answer of before arrives later.
    const already = Number(picture.dataset.number) === number && picture.dataset.settled === "1";
    const released = already || answer.headers.get("X-Settled") === "1";
    if (released) settled = data;
    picture.dataset.settled = released ? "1" : "0";
    picture.dataset.number = number;
  }

  function draw() {
    const scenes = current.scenes.map((scene) => (wanted.rigid ? scene : { ...scene, ghost: null }));
    if (!load) load = makePlayer(place(), { ...current, scenes });
    else load({ ...current, scenes }, wanted.previous ? ghost : null, fresh);
    fresh = false;
    placeHandles();
  }

  // Forget the runs of the arm before.
  function begin() {
    settled = null;
    fresh = true;
  }

  // Handles on the picture for the points of the motion: [path, name, [x, y] in m].
  // Lists that answer all but the last of the moves that were sent are older than the handles.
  let points = [], sent = 0, unanswered = 0;
  function setPoints(list) {
    if (unanswered > 0 && --unanswered > 0) return;
    const paths = (all) => all.map((point) => point[0]).join();
    if (paths(list) !== paths(points)) document.querySelectorAll(".handle").forEach((each) => each.remove());
    points = list;
    placeHandles();
  }
  const canvasOfArm = () => document.querySelector(".picture .arm canvas");
  function placeHandles() {
    const canvas = canvasOfArm();
    if (!canvas || !canvas.map) return;
    const [toX, toY] = canvas.map, there = [...canvas.parentNode.querySelectorAll(".handle")];
    points.forEach((point, k) => {
      const handle = there[k] || addHandle(canvas.parentNode, k), [x, y] = point[2];
      handle.style.left = toX(x) + "px";
      handle.style.top = toY(y) + "px";
      handle.setAttribute("aria-label", point[1] + " of the motion at " + x + ", " + y + " m");
      handle.title = point[1] + ": " + x + ", " + y + " m. Drag it, or press the arrow keys.";
    });
  }
  function addHandle(arm, k) {
    const handle = document.createElement("button");
    handle.className = "handle";
    handle.type = "button";
    arm.append(handle);
    let moved = false;
    // Go to a place in pixels of the canvas, in steps of a pixel.
    function go(px, py) {
      const [toX, toY] = canvasOfArm().map, scale = toX(1) - toX(0);
      const digits = Math.max(0, Math.ceil(Math.log10(scale)));
      points[k][2] = [(px - toX(0)) / scale, (toY(0) - py) / scale].map((v) => Number(v.toFixed(digits)));
      moved = true;
      placeHandles();
      if (performance.now() - sent > 40) tell(false);
    }
    function tell(released) {
      sent = performance.now();
      unanswered += released;
      emitEvent("studio_point", [points[k][0], points[k][2], released]);
    }
    function release() { if (moved) tell(true); moved = false; }
    handle.addEventListener("pointerdown", (event) => handle.setPointerCapture(event.pointerId));
    handle.addEventListener("pointermove", (event) => {
      if (!handle.hasPointerCapture(event.pointerId)) return;
      const canvas = canvasOfArm(), box = canvas.getBoundingClientRect();
      const factor = canvas.clientWidth / box.width; // of a page that is enlarged
      go((event.clientX - box.left) * factor, (event.clientY - box.top) * factor);
    });
    handle.addEventListener("lostpointercapture", release);
    const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    handle.addEventListener("keydown", (event) => {
      const step = steps[event.key], [toX, toY] = canvasOfArm().map, far = event.shiftKey ? 1 : 5;
      if (!step) return;
      event.preventDefault();
      go(toX(points[k][2][0]) + far * step[0], toY(points[k][2][1]) + far * step[1]);
    });
    handle.addEventListener("keyup", release);
    handle.addEventListener("blur", release);
    return handle;
  }
  window.addEventListener("resize", () => requestAnimationFrame(placeHandles)); // drawn by then

  // Dark or light as the system, unless the user has chosen the other one, in this browser.
  const DARK = "flexarm-studio-dark";
  function setDark(chosen) {
    Quasar.Dark.set(chosen === null ? "auto" : chosen === "true");
    window.dispatchEvent(new Event("resize")); // draws the canvases
  }
  function toggleDark() {
    const dark = !Quasar.Dark.isActive;
    if (dark === window.matchMedia("(prefers-color-scheme: dark)").matches) localStorage.removeItem(DARK);
    else localStorage.setItem(DARK, dark);
    setDark(localStorage.getItem(DARK));
  }

  // A link to a state is opened once; reloading the page keeps the state.
  function follow() {
    setDark(localStorage.getItem(DARK));
    if (location.hash.length < 2) return;
    emitEvent("studio_link", location.hash.slice(1));
    history.replaceState({}, "", location.pathname);
  }
  window.addEventListener("hashchange", follow);

  // The player, and below it a box for each ghost.
  function place() {
    const picture = document.querySelector(".picture");
    const root = document.createElement("div"), boxes = document.createElement("div");
    boxes.className = "ghosts";
    for (const [name, words] of [["rigid", "rigid arm"], ["previous", "previous run"]]) {
      const label = document.createElement("label"), box = document.createElement("input");
      box.type = "checkbox";
      box.checked = true;
      box.addEventListener("change", () => { wanted[name] = box.checked; draw(); });
      label.append(box, words);
      boxes.append(label);
    }
    root.className = "flexarm-player";
    picture.append(root, boxes);
    return root;
  }

  // Focus a field, or the first whose path begins so, if the focused control was replaced.
  function focus(path) {
    setTimeout(() => {
      if (document.activeElement !== document.body) return;
      const fields = [...document.querySelectorAll(".field")];
      const field = fields.find((each) => each.dataset.path === path)
        || fields.find((each) => each.dataset.path.startsWith(path));
      field?.querySelector("input, textarea, button, [tabindex='0']")?.focus();
    }, 50);
  }

  // Ctrl+Z in a text field undoes typing; elsewhere it undoes an edit.
  document.addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey) || event.altKey) return;
    if (event.target.matches("textarea, input:not([type=checkbox]):not([type=range])")) return;
    const key = event.key.toLowerCase();
    const name = key === "y" || (key === "z" && event.shiftKey) ? "redo" : key === "z" ? "undo" : "";
    if (!name) return;
    event.preventDefault();
    document.querySelector("." + name).click();
  });
  return { show, begin, focus, follow, toggleDark, points: setPoints };
})();
