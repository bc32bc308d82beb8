// Faults of the open page of the site, as sentences; test_site_pages.py runs this in each view.
() => {
  const faults = new Set();
  const width = document.documentElement.clientWidth;
  const excerpt = element => `<${element.localName}> "${element.textContent.trim().slice(0, 40)}"`;
  const overflow = document.documentElement.scrollWidth - width;
  if (overflow > 0) faults.add(`the page is ${overflow} pixels wider than the window`);

  for (const image of document.images) {
    if (image.naturalWidth === 0) faults.add(`missing picture ${image.src}`);
  }
  for (const equation of document.querySelectorAll("math")) {
    if (!equation.checkVisibility()) continue;
    const {width, height} = equation.getBoundingClientRect();
    if (width < 2 || height < 4 || equation.querySelector("merror")) {
      faults.add(`equation without size or with an error: ${excerpt(equation)}`);
    }
  }

  const raw = [...document.querySelectorAll("article p, article li, article td, article h2")]
    .find(element => /\] ?\([^)]*(\.md|#)|```/.test(element.textContent));
  if (raw) faults.add(`Markdown is not rendered: ${excerpt(raw)}`);

  // Red, green, blue from 0 to 255 and opacity from 0 to 1 of a computed colour.
  const pen = new OffscreenCanvas(1, 1).getContext("2d", {willReadFrequently: true});
  const colors = new Map();
  const parsed = color => {
    if (!colors.has(color)) {
      pen.clearRect(0, 0, 1, 1);
      pen.fillStyle = color;
      pen.fillRect(0, 0, 1, 1);
      const [red, green, blue, alpha] = pen.getImageData(0, 0, 1, 1).data;
      colors.set(color, [red, green, blue, alpha / 255]);
    }
    return colors.get(color);
  };
  const over = ([...top], bottom) =>
    [0, 1, 2].map(k => top[3] * top[k] + (1 - top[3]) * bottom[k]);
  const grounds = new Map();
  const ground = element => {
    if (element === null) return [255, 255, 255];
    if (!grounds.has(element)) {
      const color = parsed(getComputedStyle(element).backgroundColor);
      grounds.set(element, color[3] === 1 ? color.slice(0, 3) : over(color, ground(element.parentElement)));
    }
    return grounds.get(element);
  };
  // Contrast by the Web Content Accessibility Guidelines 2.2.
  const luminance = color => {
    const [red, green, blue] = color.map(value =>
      value <= 10.31475 ? value / 3294.6 : ((value / 255 + 0.055) / 1.055) ** 2.4);
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue;
  };
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (texts.nextNode()) {
    const element = texts.currentNode.parentElement;
    if (!texts.currentNode.data.trim() || element.closest("script, style, svg, option")) continue;
    if (!element.checkVisibility({opacityProperty: true, visibilityProperty: true})) continue;
    const box = element.getBoundingClientRect();
    if (box.width < 2 || box.height < 2) continue;  // labels for screen readers
    const style = getComputedStyle(element), below = ground(element);
    const pair = [luminance(over(parsed(style.color), below)), luminance(below)];
    const contrast = (Math.max(...pair) + 0.05) / (Math.min(...pair) + 0.05);
    const least = /[\p{L}\p{N}]/u.test(texts.currentNode.data) ? 4.5 : 3;  // of text, of marks
    if (contrast < least) faults.add(`contrast ${contrast.toFixed(1)} of ${style.color}: ${excerpt(element)}`);
    const size = parseFloat(style.fontSize);
    if (size < 11 && !element.closest("math, sup, sub")) {
      faults.add(`text of ${size.toFixed(1)} pixels: ${excerpt(element)}`);
    }
    // Text beyond the window must be in a box that scrolls.
    if (box.right > width + 1 && box.left >= 0) {
      let parent = element;
      while (parent && !/auto|scroll/.test(getComputedStyle(parent).overflowX)) parent = parent.parentElement;
      if (!parent && !element.closest("[class*=sidebar], [class*=drawer]")) faults.add(`text beyond the window: ${excerpt(element)}`);
    }
  }
  return [...faults];
}
