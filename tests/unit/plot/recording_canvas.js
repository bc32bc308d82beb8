// Runs the script of a page of `animate` with a canvas that records where dots are drawn.
const fs = require("fs"), vm = require("vm");
const text = fs.readFileSync(process.argv[2], "utf8");
const json = text.match(/class="flexarm-data">([^]*?)<\/script>/)[1];
const code = text.match(/<\/script><script>([^]*?)<\/script>/)[1];
const dots = [], listeners = {};
const draw = new Proxy({}, {
  get: (own, name) => {
    if (name === "measureText") return (words) => ({ width: 6 * words.length });
    if (name === "arc") return (x, y, radius) => dots.push([x, y, radius]);
    return name in own ? own[name] : () => {};
  },
});
function element(tag) {
  const made = { tag, className: "", children: [], style: {}, clientWidth: 564, clientHeight: 572,
    appendChild(child) { made.children.push(child); return child; },
    setAttribute() {}, getContext: () => draw, replaceChildren() { made.children.length = 0; },
    addEventListener(name, call) { listeners[made.className + " " + name] = call; made[name] = call; } };
  return made;
}
const root = element("div");
const data = { textContent: json, previousElementSibling: root };
const document = { currentScript: { previousElementSibling: data }, createElement: element };
const matchMedia = () => ({ matches: true, addEventListener() {} });
const window = { devicePixelRatio: 1, addEventListener() {}, matchMedia };
const getComputedStyle = () => ({ getPropertyValue: () => "#808080" });
vm.runInNewContext(code, { document, window, getComputedStyle, performance: { now: () => 0 },
  requestAnimationFrame() {}, console, Math, JSON, Number });
const controls = root.children[1].children;
const [button, slider, clock] = controls;
const payload = () => dots.filter((dot) => dot[2] === 6).pop().slice(0, 2);
const first = payload();
button.click();
const playing = button.textContent;
slider.value = 4;
slider.input();
console.log(JSON.stringify({ first, moved: payload(), playing, clock: clock.textContent }));
