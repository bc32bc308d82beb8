// Shows the newest picture of a window; `makePlayer` is the function of the player.
window.flexarmStudio = (function () {
  "use strict";
  let load = null; // of the player, once there is one
  let shown = 0; // number of the picture that is shown
  let current = null; // its data
  let ghost = null; // data of the run before it
  let settled = null; // data of the last picture of a released slider: the ghost of the next one
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
    else load({ ...current, scenes }, wanted.previous ? ghost : null);
  }

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
  return { show, focus };
})();
