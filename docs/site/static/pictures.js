// A button that stops the moving pictures of a page; they start stopped for readers who prefer that.
document.addEventListener("DOMContentLoaded", () => {
  const shown = location.pathname.includes("/cards/") ? 'article img[src*=".svg"]' : 'a[href*="cards/"] img';
  const moving = [...document.querySelectorAll(shown)];
  if (moving.length === 0) return;
  const button = document.createElement("button");
  button.className = "pause-pictures";
  let paused = matchMedia("(prefers-reduced-motion: reduce)").matches;
  const show = () => {
    button.textContent = paused ? "Play pictures" : "Pause pictures";
    for (const picture of moving) {
      picture.src = picture.src.split("#")[0] + (paused ? "#still" : "");
    }
  };
  button.addEventListener("click", () => { paused = !paused; show(); });
  document.querySelector("article h1").before(button);
  if (paused) show(); else button.textContent = "Pause pictures";
});
