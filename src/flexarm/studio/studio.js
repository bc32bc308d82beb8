// Shows the newest picture of a window; `makePlayer` is the function of the player.
window.flexarmStudio = (function () {
  "use strict";
  let load = null; // of the player, once there is one
  let shown = 0; // number of the picture that is shown
  let current = null; // data of that picture
  let settled = null; // data of the last picture of a released slider: the ghost of the next one

  // The server answers with the number of the picture alone if it is shown already.
  async function show(key) {
    const answer = await fetch("picture/" + key + "?shown=" + shown, { cache: "no-store" });
    if (!answer.ok) return;
    const number = Number(answer.headers.get("X-Number"));
    const data = answer.status === 200 ? await answer.json() : current;
    if (number < shown) return; // an older answer was slower
    if (number > shown) {
      if (load) load(data, settled); else load = makePlayer(place(), data);
    }
    [shown, current] = [number, data];
    if (answer.headers.get("X-Settled") === "1") settled = data;
    const picture = document.querySelector(".picture");
    picture.dataset.settled = answer.headers.get("X-Settled");
    picture.dataset.number = number;
  }

  function place() {
    const root = document.createElement("div");
    root.className = "flexarm-player";
    document.querySelector(".picture").appendChild(root);
    return root;
  }

  // Ctrl+Z in a text field undoes typing; elsewhere it undoes an edit.
  document.addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey) || event.altKey || event.target.tagName === "INPUT") return;
    const key = event.key.toLowerCase();
    const name = key === "y" || (key === "z" && event.shiftKey) ? "redo" : key === "z" ? "undo" : "";
    if (!name) return;
    event.preventDefault();
    document.querySelector("." + name).click();
  });
  return { show };
})();
